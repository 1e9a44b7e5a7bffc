"""Submissions as students hand them in: their points by each rubric, and the sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from student_code import WORKS, Work
from user_files import LocalCode

from barc_sim.lab.check.lab import Settings
from barc_sim.lab.confined.process import Limits
from barc_sim.lab.grade.grade import grade, report
from barc_sim.lab.grade.rubric import ByHand, load
from barc_sim.lab.grade.submissions import Submission
from barc_sim.lab.handout import RUBRICS, files_in
from barc_sim.lab.hills.lab import HILLS
from barc_sim.lab.hills.relay import LABELS as RELAY
from barc_sim.lab.user_code.code import UserCode

if TYPE_CHECKING:
    from pathlib import Path

SEED = load().settings.seed
#: Judged by `check` and `grade`, which share a judge.
SOME = ('the published law', 'an error at a low speed')


def write(folder: Path, work: Work) -> Path:
    for name, text in zip(work.files, (work.model, work.controller), strict=True):
        (folder / name).write_text(text)
    return folder


def submission(work: Work) -> Submission:
    texts = (work.model.encode(), work.controller.encode())
    return Submission('student', dict(zip(work.files, texts, strict=True)))


@pytest.mark.parametrize('name', WORKS)
def test_points_by_each_rubric_and_the_sentence(tmp_path: Path, name: str) -> None:
    work = WORKS[name]
    code = LocalCode(UserCode(files_in(write(tmp_path, work)), budget=None, packages=False))
    findings = HILLS.judge(code, Settings(seed=SEED))
    points = [
        sum(rubric.points_for(f) for f in findings if f.criterion in rubric.points)
        for rubric in map(load, RUBRICS)
    ]
    assert points == pytest.approx(work.points, abs=0.006)
    messages = [finding.message for finding in findings]
    assert work.sentence in '; '.join([*messages, *code.tolerated()])
    assert str(tmp_path) not in ''.join(messages)


@pytest.mark.usefixtures('confinement')
@pytest.mark.parametrize('name', SOME)
def test_check_and_grade_agree_to_the_point(tmp_path: Path, name: str) -> None:
    work, rubric = WORKS[name], load('extended')
    checked = HILLS.judge_folder(write(tmp_path, work), rubric.settings)
    graded = grade(submission(work), rubric, Limits(), sandbox=True)
    assert [(item.criterion, item.points) for item in graded.items] == [
        (finding.criterion, rubric.points_for(finding))
        for finding in checked.findings
        if finding.criterion not in RELAY
    ]
    assert [item.criterion for item in graded.items] == [*HILLS.labels][: -len(RELAY)]
    assert graded.gains == str(checked.gains or '')
    assert graded.tolerated == checked.tolerated


@pytest.mark.usefixtures('confinement')
def test_two_runs_give_the_same_bytes(tmp_path: Path) -> None:
    folder, rubric = write(tmp_path, WORKS[SOME[0]]), load()
    one, other = (report(folder, ByHand(), rubric, Limits(), sandbox=True) for _ in range(2))
    assert one == other
    assert b'barc_sim_grade_' not in b''.join(one.files.values())
