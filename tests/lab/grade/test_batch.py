"""Several submissions at once."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from barc_sim.lab.grade import grade
from barc_sim.lab.grade.rubric import ByHand

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import pytest


def test_a_fault_of_the_grader_does_not_stop_the_others(
    folder: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def report(path: Path, *_: object, **__: object) -> str:
        if path.name == 's1':
            raise MemoryError('too little')
        return path.name

    monkeypatch.setattr(grade, 'report', report)
    paths = {folder(f's{i}'): ByHand() for i in range(3)}
    with ThreadPoolExecutor(2) as pool:
        outcomes = grade.run(pool, paths, sandbox=True)
        found = {path.name: outcome for path, outcome in outcomes}

    assert found == {
        's0': 's0',
        's1': 'MemoryError: too little',
        's2': 's2',
    }
