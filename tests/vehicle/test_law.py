"""A law is a function in Python, and is compiled with the loops that call it."""

from __future__ import annotations

import os
import time
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import pytest

from barc_sim.vehicle.law import announce, compiled, is_compiled, law

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


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
def test_several_threads_can_compile_loops_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    registered: list[object] = []

    def register(**_: object) -> Callable[[object], None]:
        time.sleep(0.0)  # lets another thread run
        return registered.append

    monkeypatch.setattr('numba.extending.register_jitable', register)
    monkeypatch.setattr('barc_sim.vehicle.law._laws', [])
    laws = [law(lambda x: x) for _ in range(200)]
    with ThreadPoolExecutor(8) as threads:
        loops = [threads.submit(compiled.__wrapped__, total) for _ in range(8)]
    assert all(callable(loop.result()) for loop in loops)
    assert len(registered) == len(laws)


@pytest.mark.skipif(not is_compiled(), reason='needs the extra fast')
def test_laws_compile_without_a_writable_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocked = tmp_path / 'file'
    blocked.touch()
    monkeypatch.setenv('XDG_CACHE_HOME', str(blocked))
    assert compiled.__wrapped__(total)(3) == 8.0


@pytest.mark.skipif(not is_compiled(), reason='needs the extra fast')
def test_a_terminal_shows_a_line_while_laws_are_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    compiled.__wrapped__(total)(3)
    assert capsys.readouterr().err == ''

    monkeypatch.setattr('sys.stderr.isatty', lambda: True)
    announce.cache_clear()
    other_cache = tmp_path / 'other'
    monkeypatch.setenv('XDG_CACHE_HOME', str(other_cache))
    compiled.__wrapped__(total)(3)
    assert capsys.readouterr().err == 'Compiling the laws takes some seconds, once.\n'
    assert any(other_cache.rglob('*.nbi'))

    compiled.__wrapped__(total)(3)
    assert capsys.readouterr().err == ''


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
