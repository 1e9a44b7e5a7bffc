"""Submissions on several processes, of this machine or of a cluster."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Event
from typing import TYPE_CHECKING

import pytest
from user_files import CONTROLLER

from barc_sim.lab.confined.process import Limits
from barc_sim.lab.grade import batch, rubric

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from barc_sim.lab.grade.submissions import Submission


def test_a_fault_of_the_grader_does_not_stop_the_others(
    folder: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def report(submission: Submission, **_: object) -> str:
        if submission.name == 's1':
            raise MemoryError('too little')
        return submission.name

    monkeypatch.setattr(batch, 'report', report)
    paths = [folder(f's{i}') for i in range(3)]
    with (
        ThreadPoolExecutor(2) as pool,
        batch.run(pool, paths, rubric.load(), Limits(), at_once=2, sandbox=True) as outcomes,
    ):
        found = {path.name: outcome for path, outcome in outcomes}

    assert found == {
        's0': 's0',
        's1': batch.Failure('MemoryError: too little'),
        's2': 's2',
    }


def test_those_that_have_not_begun_never_do_when_it_is_left(
    folder: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = []
    go_on = Event()

    def report(submission: Submission, **_: object) -> None:
        begun.append(submission.name)
        if submission.name != 's0':
            go_on.wait(30.0)

    monkeypatch.setattr(batch, 'report', report)
    paths = [folder(f's{i}') for i in range(9)]
    with ThreadPoolExecutor(1) as pool:
        with batch.run(pool, paths, rubric.load(), Limits(), at_once=4, sandbox=True) as outcomes:
            assert next(outcomes)[0].name == 's0'
        go_on.set()

    assert len(begun) <= 2


@pytest.mark.usefixtures('confinement')
def test_a_cluster_gives_the_same_scores(folder: Callable[..., Path], tmp_path: Path) -> None:
    pytest.importorskip('distributed')
    paths = [folder(f's{i}', controller=CONTROLLER) for i in range(2)]
    # In a process of its own, for its event loops and its warnings.
    script = f"""
from distributed import LocalCluster
from barc_sim.__main__ import main as barc
if __name__ == '__main__':
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        print(barc(['grade', {str(tmp_path / 'class')!r}, '--out', {str(tmp_path / 'grades')!r},
                    '--scheduler', cluster.scheduler_address]))
"""
    (tmp_path / 'class').mkdir()
    for path in paths:
        path.rename(tmp_path / 'class' / path.name)
    (tmp_path / 'script.py').write_text(script)

    done = subprocess.run(
        [sys.executable, str(tmp_path / 'script.py')],
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )

    assert done.stdout.endswith('\n0\n'), done.stderr
    lines = (tmp_path / 'grades' / 'class.csv').read_text().splitlines()
    assert [line.split(',')[:2] for line in lines[1:]] == [['s0', '50.0'], ['s1', '50.0']]
