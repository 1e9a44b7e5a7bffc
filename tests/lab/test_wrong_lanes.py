"""Wrong and unusual programs of Lab 3: what a fair instructor says, of which line, and the points.

The table was written before the code that is tested. A program is a right one, and what is
replaced in it. All have 90 points at most: 10 are judged by eye.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from user_files import LANE as RIGHT
from user_files import points_of, read_programs, replaced

from barc_sim import lap
from barc_sim.lab.confined.process import ProcessLimits
from barc_sim.lab.grade.grade import load_rubric
from barc_sim.lab.labs.lane import LABELS, LANE, hidden_track

if TYPE_CHECKING:
    from pathlib import Path


PROGRAMS = read_programs('wrong_lanes.txt')

#: What stands in the table for longer texts.
TEXTS = {
    'PURE_PURSUIT': """x, y, psi, ds = 0.0, 0.0, 0.0, 0.5
        for i in range(8):
            turn = ds * curvature((i + 0.5) * ds)
            x, y = x + ds * cos(psi + turn / 2), y + ds * sin(psi + turn / 2)
            psi += turn
        x, y = x + l_r * cos(e_psi), y - e_y + l_r * sin(e_psi)
        return atan(2 * L * sin(atan2(y, x) - e_psi) / hypot(x, y))
        k = 0.0""",
    'STANLEY': """front = e_y + l_r * sin(e_psi)
        return l_r * curvature(l_r) - e_psi - atan(2.0 * front / (1.0 + speed))
        k = 0.0""",
    'PID': """change = 0.0 if self.before is None else (e_y - self.before) / 0.02
        self.before = e_y
        return -0.3 * e_y - 0.25 * change
        k = 0.0""",
}
RUBRIC = load_rubric('lane')


def text_of(name: str) -> str:
    """Return the text of a program."""
    text = replaced(RIGHT, *PROGRAMS[name].changes)
    for short, long in TEXTS.items():
        text = text.replace(short, long)
    return text


@pytest.mark.parametrize('name', PROGRAMS)
def test_a_wrong_lane_gets_its_points_sentence_and_line(tmp_path: Path, name: str) -> None:
    program, text = PROGRAMS[name], text_of(name)
    # What is wrong in a function alone does not change the drives.
    drives = name == 'right' or text.partition('class ')[2] != RIGHT.partition('class ')[2]
    criteria = [each for each in RUBRIC.points if drives or each in LABELS]
    points = points_of(program, text, RUBRIC, tmp_path, criteria)
    assert points + 55.0 * (not drives) == pytest.approx(program.points, abs=5.0)


def test_an_endless_loop_in_a_step_costs_the_drives_alone(tmp_path: Path) -> None:
    text = replaced(RIGHT, ('k = curvature(0.0)', 'while True: k = curvature(0.0)'))
    (tmp_path / 'lane.py').write_text(text, encoding='utf-8')
    report = LANE.judge_folder(tmp_path, RUBRIC.settings, ProcessLimits(call=0.2, confined=False))
    assert sum(map(RUBRIC.points_for, report.findings)) == 35.0
    wrong = [each for each in report.findings if not (each.passed or each.open)]
    assert all('endless loop' in each.message for each in wrong)


@pytest.mark.parametrize(
    ('name', 'laps'), [('right', ['1', '2', '3']), ('nothing', ['not finished'])]
)
def test_a_lap_that_ends_off_the_track_has_no_number(
    tmp_path: Path, name: str, laps: list[str]
) -> None:
    (tmp_path / 'lane.py').write_text(text_of(name), encoding='utf-8')
    drive = LANE.judge_folder(tmp_path, RUBRIC.settings).drive
    assert drive
    assert [number for number, *_ in drive.rows] == laps


@pytest.mark.parametrize('seed', range(20))
def test_the_hidden_track_is_closed_and_can_be_driven(seed: int) -> None:
    track = hidden_track(seed)
    assert track.is_closed
    assert track.curvature(30.0) < 0.0  # it turns to the right first
    assert track != hidden_track(seed + 1)
    if seed < 3:
        log = lap(track=track, laps=1, dynamics='dynamic')
        assert abs(log.e_y).max() < 0.25
