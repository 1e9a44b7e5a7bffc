"""Wrong and unusual programs: what a fair instructor says, of which line, and the points.

The table was written before the code that is tested. A program is a right one, and what is
replaced in it. Those of relays, and of nodes that read the keys themselves, are in
`grade/test_relay.py`.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest
from user_files import PLAIN_CONTROLLER, PLAIN_MODEL, Program, judged_file, read_programs, replaced

from barc_sim.lab.confined.process import ProcessLimits
from barc_sim.lab.files import FILES
from barc_sim.lab.grade.grade import load_rubric
from barc_sim.lab.labs.hills import HILLS

if TYPE_CHECKING:
    from pathlib import Path

    from barc_sim.lab.judge import Finding


PROGRAMS = read_programs('wrong_programs.txt')

LAB = load_rubric('lab')


def texts_of(program: Program) -> dict[str, str]:
    """Return the files of a program, by part."""
    texts = [PLAIN_MODEL, PLAIN_CONTROLLER]
    for old, new in program.changes:
        part = 0 if old in texts[0] else 1
        texts[part] = replaced(texts[part], (old, new))
    return dict(zip(('model', 'controller'), texts, strict=True))


def judged(texts: dict[str, str]) -> dict[str, Finding]:
    """Return the findings on files, by part, by the rubric `lab`."""
    findings_of_files = [
        judged_file(part, FILES[part], text, LAB.settings)[0] for part, text in texts.items()
    ]
    return {each.criterion: each for findings in findings_of_files for each in findings}


def points(findings: dict[str, Finding]) -> float:
    return sum(LAB.points_for(each) for each in findings.values() if not each.skipped)


def remarks(findings: dict[str, Finding]) -> str:
    return '\n'.join(each.message for each in findings.values())


@pytest.mark.parametrize('name', PROGRAMS)
def test_a_wrong_program_gets_its_points_sentence_and_line(name: str) -> None:
    program = PROGRAMS[name]
    texts = texts_of(program)
    findings = judged(texts)
    assert program.sentence in remarks(findings)
    assert points(findings) == pytest.approx(program.points, abs=5.0)

    if program.line:
        remark = next(m for m in remarks(findings).splitlines() if program.sentence in m)
        file, number = re.findall(r'(\w+\.py), line (\d+)', remark)[0]
        (part,) = (part for part, name in FILES.items() if name == file)
        line = texts[part].splitlines()[int(number) - 1]
        assert line.strip().startswith(program.line)


def test_a_multiple_of_the_error_in_place_of_d_makes_no_weak_loop_stronger() -> None:
    weak = replaced(PLAIN_CONTROLLER, ('kp=30, ki=60, kd=0.1', 'kp=2, ki=0.2, kd=0.5'))
    wrong = replaced(weak, ('self.e_before = e\n', 'self.e_before = 0.0\n'))
    alone, with_error = (judged({'controller': text}) for text in (weak, wrong))
    drives = [findings['loop.lab_road'].score for findings in (alone, with_error)]
    assert drives[0] == pytest.approx(drives[1], abs=0.01)
    assert drives[0] < 0.5
    assert with_error['pid.derivative'].score == 0.0


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        (PLAIN_CONTROLLER.replace('dt = 0.02', 'while True: pass'), 'is there an endless loop?'),
        (PLAIN_CONTROLLER.replace('dt = 0.02', 'import os; os._exit(1)'), 'ended itself'),
    ],
    ids=['endless loop', 'exit'],
)
def test_the_remark_names_why_a_controller_does_not_run(
    tmp_path: Path, text: str, words: str
) -> None:
    (tmp_path / 'bike_model.py').write_text(PLAIN_MODEL, encoding='utf-8')
    (tmp_path / 'controller.py').write_text(text, encoding='utf-8')
    report = HILLS.judge_folder(tmp_path, LAB.settings, ProcessLimits(call=0.2, confined=False))
    findings = {each.criterion: each for each in report.findings if not each.skipped}
    assert points(findings) == 50.0  # of the model
    for criterion in ('pid.proportional', 'pid.integral', 'pid.derivative', 'loop.lab_road'):
        assert words in findings[criterion].message
