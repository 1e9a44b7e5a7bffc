"""Submissions as students hand them in: their points, and the sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from student_code import WORKS, Work
from user_files import judged_file

from barc_sim.lab.confined.process import ProcessLimits
from barc_sim.lab.grade.grade import ByHand, load_rubric, report
from barc_sim.lab.judge import Settings
from barc_sim.lab.labs.hills import HILLS
from barc_sim.lab.labs.relay import LABELS as RELAY
from barc_sim.lab.submission import read_submission

if TYPE_CHECKING:
    from pathlib import Path

LAB = load_rubric()


def write(folder: Path, work: Work) -> Path:
    for name, text in zip(work.files, (work.model, work.controller), strict=True):
        (folder / name).write_text(text)
    return folder


@pytest.mark.parametrize('name', WORKS)
def test_a_ros_1_script_gets_its_points_and_sentence(name: str) -> None:
    work = WORKS[name]
    files = zip(('model', 'controller'), work.files, (work.model, work.controller), strict=True)
    judged = [judged_file(*file, Settings(seed=LAB.settings.seed)) for file in files]
    findings = [finding for found, _ in judged for finding in found]
    points = sum(LAB.points_for(each) for each in findings if each.criterion in LAB.points)
    assert points == pytest.approx(work.points, abs=0.006)
    messages = [finding.message for finding in findings]
    assert work.sentence in '; '.join([*messages, *(each for _, own in judged for each in own)])


@pytest.mark.usefixtures('confinement')
def test_check_and_grade_agree_to_the_point(tmp_path: Path) -> None:
    work = WORKS['everything with dt']
    folder = write(tmp_path, work)
    checked = HILLS.judge_folder(folder, LAB.settings)
    graded = report(read_submission(folder), ByHand(), LAB, ProcessLimits())

    assert [(item.criterion, item.points) for item in graded.items] == [
        (finding.criterion, LAB.points_for(finding))
        for finding in checked.findings
        if finding.criterion not in RELAY
    ]
    assert graded.gains == str(checked.gains or '')
    assert graded.tolerated == checked.tolerated
    assert b'barc_sim_grade_' not in b''.join(graded.files.values())
