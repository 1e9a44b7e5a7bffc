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
from barc_sim.lab.grade.grade import load
from barc_sim.lab.labs.lane import LABELS, LANE, hidden_track

if TYPE_CHECKING:
    from pathlib import Path


PROGRAMS = read_programs("""
right | 90 |  | the signs are right
e_y's sign in both | 86 | e_y = -(y | e_y of straight_errors has the wrong sign
    e_y = (y - y_0) * cos(psi_0) - -> e_y = -(y - y_0) * cos(psi_0) +
    e_y = radius - side * distance -> e_y = side * distance - radius
e_psi's sign in both | 86 | e_psi = wrap(psi_0 | e_psi of straight_errors has the wrong sign
    wrap(psi - psi_0) -> wrap(psi_0 - psi)
    wrap(psi - heading) -> wrap(heading - psi)
e_psi not wrapped | 87 | e_psi = psi | e_psi of straight_errors is not wrapped
    wrap(psi - psi_0) -> psi - psi_0
    wrap(psi - heading) -> psi - heading
errors in degrees | 87 | e_psi = | e_psi of straight_errors is in degrees
    wrap(psi - psi_0) -> wrap(psi - psi_0) * 180 / pi
    wrap(psi - heading) -> wrap(psi - heading) * 180 / pi
steady in degrees | 84 | delta = | steady returns degrees
    sqrt(1 - sine**2)) -> sqrt(1 - sine**2)) * 180 / pi
    e_psi = -asin(sine) -> e_psi = -asin(sine) * 180 / pi
    delta, e_steady = steady(k) -> delta, e_steady = (pi / 180 * each for each in steady(k))
the sign of steady's e_psi | 82 | e_psi = asin | e_psi of steady has the wrong sign
    -asin(sine) -> asin(sine)
    e_psi - e_steady -> e_psi + e_steady
e_y's sign in Lane | 82 | steer = | is the sign of e_y right?
    - self.k_y -> + self.k_y
e_psi's sign in Lane | 82 | steer = | is the sign of e_psi right?
    - self.k_psi -> + self.k_psi
the curvature's sign | 82 | k = | is the sign of the curvature right?
    k = curvature(0.0) -> k = -curvature(0.0)
no feedforward | 76 | steer = | the curvature has no effect
    steer = delta - self.k_y * e_y - self.k_psi * e -> steer = -self.k_y * e_y - self.k_psi * e_psi
e_psi to 0 | 83 |  | in a turn e_psi must be the one of steady
    e = e_psi - e_steady -> e = e_psi
degrees in Lane | 75 | steer = | is it in degrees?
    return steer -> steer = steer * 180 / pi⏎        return steer
e_psi alone | 74 | steer = | e_y has no effect
    - self.k_y * e_y -> + 0.0
e_y alone | 73 | steer = | e_psi has no effect
    - self.k_psi * e -> + 0.0
a late curvature | 80 | k = | the curvature is read 4 m too late
    curvature(0.0) -> curvature(-4.0)
always at the limit | 75 | steer = | the gains are too large
    return steer -> steer = 30 * steer⏎        return steer
gains too large | 75 | steer = | the gains are too large
    - self.k_y * e_y - self.k_psi * e -> - 30 * (self.k_y * e_y + self.k_psi * e)
a weak law | 74 | steer = | the gain of e_y is too small
    self.k_y = 0.22 -> self.k_y = 0.02
a bias | 85 | steer = | a mirrored e_y must give the opposite angle
    steer = delta -> steer = 0.02 + delta
nothing | 35 |  | the steering angle is the same
    return steer -> return 0.0
pure pursuit | 87 |  | the signs are right
    k = curvature(0.0) -> PURE_PURSUIT
Stanley | 85 |  | the signs are right
    k = curvature(0.0) -> STANLEY
a PID on e_y | 73 |  | the curvature has no effect
    self.k_psi = 0.95 -> self.before = None
    k = curvature(0.0) -> PID
the template's Lane | 35 | raise | is not written yet (TODO)
    k = curvature(0.0) -> raise NotImplementedError⏎        k = 0.0
a function for the class | 35 |  | lane.py defines no Lane
    class Lane: -> class Steering:
a missing colon | 0 | class Lane | syntax error
    class Lane: -> class Lane
a misspelt function | 75 |  | lane.py defines no steady
    def steady( -> def steadi(
    steady(k) -> steadi(k)
curvature as a number | 35 | sine = | is a call missing
    k = curvature(0.0) -> k = curvature
""")

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
RUBRIC = load('lane')


def text_of(name: str) -> str:
    """Return the text of a program."""
    text = replaced(RIGHT, *PROGRAMS[name].changes)
    for short, long in TEXTS.items():
        text = text.replace(short, long)
    return text


@pytest.mark.parametrize('name', PROGRAMS)
def test_points_sentence_and_line(tmp_path: Path, name: str) -> None:
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
