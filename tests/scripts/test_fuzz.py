"""A sample of `scripts/fuzz`, and that it finds what it looks for.

`BARC_SIM_SOAK=1 pytest tests/scripts/test_fuzz.py` tries 10,000 bags and 5,000 archives.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

import barc_sim
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable
    from random import Random

ROOT = Path(barc_sim.__file__).parents[1]
FUZZING = ROOT / 'scripts' / 'fuzzing'
SOAK = 'BARC_SIM_SOAK' in os.environ


@pytest.mark.timeout(3 * 3600 if SOAK else 240)
@pytest.mark.parametrize(
    ('kind', 'count'),
    [
        ('zips', 5),
        ('texts', 20),
        ('replies', 20),
        pytest.param('texts', 2_000 if SOAK else 200, marks=pytest.mark.slow),
        pytest.param('replies', 2_000 if SOAK else 200, marks=pytest.mark.slow),
        pytest.param('folders', 2_000 if SOAK else 20, marks=pytest.mark.slow),
        ('tables', 20),
        pytest.param('tables', 2_000 if SOAK else 200, marks=pytest.mark.slow),
        pytest.param('drives', 2_000 if SOAK else 10, marks=pytest.mark.slow),
        pytest.param('links', 1_000 if SOAK else 8, marks=pytest.mark.slow),
        pytest.param('limits', 1_000 if SOAK else 8, marks=pytest.mark.slow),
        pytest.param('zips', 5_000 if SOAK else 200, marks=pytest.mark.slow),
        pytest.param('bags', 10_000 if SOAK else 150, marks=pytest.mark.slow),
    ],
)
def test_damaged_files_end_in_a_result_or_a_sentence(kind: str, count: int) -> None:
    process = subprocess.run(
        [sys.executable, str(FUZZING / '_fuzz.py'), kind, '-n', str(count), '--seed', '14'],
        env=os.environ | {'PYTHONPATH': str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )

    assert process.returncode == 0, process.stderr
    assert process.stdout.splitlines()[-1].split()[:2] == ['all', str(count)]


def fault(_: Path) -> None:
    raise ZeroDivisionError


def sentence(_: Path) -> None:
    raise UserError('not this one')


def memory(_: Path) -> None:
    assert bytearray(b'x' * (600 << 20))


def hang(_: Path) -> None:
    time.sleep(60.0)


def death(_: Path) -> None:
    os._exit(9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('use', 'outcome'),
    [
        (Path.exists, 'result'),
        (sentence, 'sentence'),
        (fault, 'traceback'),
        (memory, 'memory'),
        (hang, 'hang'),
        (death, 'memory'),
    ],
)
def test_each_fault_is_found_and_the_next_file_is_tried(
    monkeypatch: pytest.MonkeyPatch, use: Callable[[Path], object], outcome: str
) -> None:
    monkeypatch.syspath_prepend(FUZZING)
    import _trial  # type: ignore[import-not-found]  # noqa: PLC0415

    monkeypatch.setattr(_trial, '_TIMEOUT', 0.5 if use is hang else 60.0)

    def damaged_file(chance: Random) -> tuple[str, str, bytes]:
        return '.mcap', f'{chance.random()}', b''

    first: list[Any] = []

    def uses(_: Random) -> list[Callable[[Path], object]]:
        first.append(use)
        return [use if len(first) == 1 else Path.exists]

    kind = SimpleNamespace(damaged_file=damaged_file, uses=uses)
    trials = list(_trial.trials(kind, 1, range(1)))
    assert [trial.outcome for trial in trials] == [outcome]
    first.append(None)
    assert [trial.outcome for trial in _trial.trials(kind, 1, range(3))] == ['result'] * 3


#: Starts a module with the working directory first in the path, and leaves it there.
UNSAFE = """\
import sys
sys.path.insert(0, '')
from barc_sim.cli import python
python._without_working_directory = lambda path: path
from runpy import run_module
run_module(sys.argv.pop(1), run_name='__main__', alter_sys=True)
"""


@pytest.mark.slow
def test_a_module_of_the_working_directory_that_runs_is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(FUZZING)
    import folders  # type: ignore[import-not-found]  # noqa: PLC0415

    command = 'info ../bag'
    kinds = {'numpy': 'file', 'mcap': 'package', 'csv': 'link', 'yaml': 'compiled'}
    imported = {*folders.imported_modules(command)}
    assert imported >= kinds.keys()
    assert imported.isdisjoint({'sys', 'matplotlib', 'scipy'})
    traps = [folders.Trap(number, kind, name) for number, (name, kind) in enumerate(kinds.items())]

    safe = folders.try_traps(command, traps, folders.Surroundings())
    monkeypatch.setattr(
        folders, 'python_command', lambda *words: [sys.executable, '-c', UNSAFE, *words]
    )
    unsafe = folders.try_traps(command, traps, folders.Surroundings())

    assert [each.outcome for each in safe] == ['result'] * len(traps)
    assert [(each.number, each.outcome) for each in unsafe] == [
        (trap.number, 'escape') for trap in traps
    ]
