"""Several submissions at once."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from barc_sim.lab.confined.process import Limits
from barc_sim.lab.grade import grade, rubric
from barc_sim.lab.grade.by_hand import ByHand

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import pytest

    from barc_sim.lab.grade.submissions import Submission


def test_a_fault_of_the_grader_does_not_stop_the_others(
    folder: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def report(submission: Submission, *_: object, **__: object) -> str:
        if submission.name == 's1':
            raise MemoryError('too little')
        return submission.name

    monkeypatch.setattr(grade, 'report', report)
    paths = {folder(f's{i}'): ByHand() for i in range(3)}
    with ThreadPoolExecutor(2) as pool:
        outcomes = grade.run(pool, paths, rubric.load(), Limits(), sandbox=True)
        found = {path.name: outcome for path, outcome in outcomes}

    assert found == {
        's0': 's0',
        's1': grade.Failure('MemoryError: too little'),
        's2': 's2',
    }
