"""A law stands in one place: a change is seen in Python and in compiled loops."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

import barc_sim
from barc_sim.vehicle.law import compiled, is_compiled, law

#: Prints the speed of the car after some steps, by the class, by `simulate`, and by `sweep`.
DRIVE = """
import json
from barc_sim import simulate, summary, sweep
from barc_sim.vehicle.bike_model import Command
from barc_sim.vehicle.plant import Plant

plant = Plant()
for _ in range(50):
    plant.advance(Command(motor=2.0))
run = summary(simulate(kp=2.0, ki=0.0, kd=0.0))
row = sweep(kp=2.0, ki=0.0, kd=0.0)
print(json.dumps([plant.state.v, run.rms_error_after_run_up, float(row.rms_error)]))
"""
RESISTANCE = 'return vehicle.air_drag_coeff * v * v + vehicle.friction'


def drive(package: Path, cache: Path) -> list[float]:
    """Return what DRIVE prints with the package in a folder."""
    done = subprocess.run(
        [sys.executable, '-c', DRIVE],
        env=os.environ | {'PYTHONPATH': str(package), 'XDG_CACHE_HOME': str(cache)},
        cwd=cache,
        capture_output=True,
        check=True,
        timeout=110,
    )
    figures: list[float] = json.loads(done.stdout)
    return figures


@pytest.mark.slow
def test_a_changed_resistance_changes_node_run_and_sweep_alike(tmp_path: Path) -> None:
    root = Path(barc_sim.__file__).parent
    changed = tmp_path / 'changed'
    shutil.copytree(root, changed / 'barc_sim', ignore=shutil.ignore_patterns('__pycache__'))
    model = changed / 'barc_sim' / 'vehicle' / 'bike_model.py'
    text = model.read_text(encoding='utf-8')
    assert text.count(RESISTANCE) == 1
    model.write_text(text.replace(RESISTANCE, f'{RESISTANCE} + 400.0'), encoding='utf-8')
    cache = tmp_path / 'cache'
    cache.mkdir()

    speed, run, swept = drive(root.parent, cache)
    slower, other_run, other_swept = drive(changed, cache)
    assert slower == pytest.approx(speed - 0.2, abs=0.01)
    assert swept == pytest.approx(run)
    assert other_swept == pytest.approx(other_run)
    assert other_run > run + 0.01


@law
def doubled(x: float) -> float:
    return 2.0 * x


def total(n: int) -> float:
    x = 1.0
    for _ in range(n):
        x = doubled(x)
    return x


def test_a_law_stays_a_function_of_python() -> None:
    assert doubled(1.5) == 3.0


@pytest.mark.skipif(not is_compiled(), reason='needs the extra fast')
def test_a_loop_is_compiled_with_the_laws_that_it_calls() -> None:
    run = compiled(total)
    assert run is not total
    assert run(10) == total(10) == 1024.0


@pytest.mark.skipif(not is_compiled(), reason='needs the extra fast')
def test_a_cache_that_cannot_be_written_is_done_without(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocked = tmp_path / 'file'
    blocked.touch()
    monkeypatch.setenv('XDG_CACHE_HOME', str(blocked))
    assert compiled.__wrapped__(total)(3) == 8.0


@pytest.mark.skipif(not is_compiled(), reason='needs the extra fast')
def test_compiled_code_of_old_sources_is_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    old, other = (tmp_path / 'barc_sim' / name for name in ('compiled-old', 'compiled-other'))
    for folder in (old, other):
        folder.mkdir(parents=True)
        (folder / 'loop.nbc').touch()
    two_months_ago = time.time() - 60 * 24 * 3600.0
    os.utime(old, (two_months_ago, two_months_ago))
    assert compiled.__wrapped__(total)(3) == 8.0
    assert not old.exists()
    assert other.exists()
