"""Relays in the manner of students: their points, and the sentence."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import pytest
from relays import (
    CALLBACK,
    CLASS,
    COMBINED,
    FUNCTION,
    ROS_1,
    ROS_2,
)
from user_files import CONTROLLER, MODEL, judged_file

import barc_sim.lab
from barc_sim.lab.confined.process import ProcessLimits
from barc_sim.lab.files import FILES
from barc_sim.lab.grade.grade import load_rubric
from barc_sim.lab.judge import Finding, Settings
from barc_sim.lab.labs.hills import HILLS
from barc_sim.lab.labs.relay import LABELS as RELAY

TEMPLATE = (Path(barc_sim.lab.__file__).parent / 'templates' / 'hills' / 'relay.py').read_text()


class Work(NamedTuple):
    """A relay, and what is expected of it."""

    text: str
    points: float
    sentence: str  #: in the message of its first criterion that is not met
    still_open: float = 0.0  #: points


def replaced(text: str, old: str, new: str) -> str:
    assert old in text
    return text.replace(old, new)


WORKS = {
    'function': Work(FUNCTION, 20, ''),
    'class that turns the wheels slowly': Work(CLASS, 20, ''),
    'program of ROS 2': Work(ROS_2, 20, ''),
    'that publishes when it gets a Twist': Work(CALLBACK, 20, ''),
    "the lab's, which keeps the last key": Work(
        ROS_1, 20, ''
    ),
    'wrong signs': Work(
        replaced(ROS_1, 'servo = 0.3', 'servo = -0.3').replace('motor = 2', 'motor = -2'),
        10, 'up commands motor -2 m/s²: the sign is wrong; down commands',
    ),
    'right is left': Work(
        replaced(FUNCTION, '0.3 *', '-0.3 *'), 15,
        'left commands servo -0.3 rad: left is positive; right commands',
    ),
    'mixed up': Work(
        replaced(FUNCTION, '[2.0 * linear_x, 0.3 * angular_z]', '[angular_z, linear_x]'),
        6, 'the key arrives as linear.x, and the order is [motor, servo]; down',
    ),
    "that gets the Twists on the handout's other topic": Work(
        replaced(ROS_1, 'turtle1/cmd_vel', 'keyboard/keyup'), 20, ''
    ),
    'keyboard and relay in one node': Work(
        COMBINED, 0, 'relay.py reads keys itself, with termios; expected a relay that gets Twists',
        20,
    ),
    'node that reads lines': Work(
        replaced(ROS_1, 'import rospy', 'import rospy, sys\nkeys = sys.stdin'), 0,
        'relay.py reads keys itself, with sys.stdin; expected a relay', 20,
    ),
    'node with a thread': Work(
     'from threading import Thread\nThread().start()\n' + ROS_1, 0,
        "raised RuntimeError: can't start new thread",
    ),
    'degrees': Work(
        replaced(FUNCTION, '0.3 *', '25 *'), 16,
        'turn by about 0.5 rad. Is it in degrees (25° are 0.436 rad), or does it grow',
    ),
    'whole radian': Work(
        replaced(FUNCTION, '0.3 *', '1.0 *'), 16, 'servo reaches 1 rad, which is 57°: the '
    ),
    'throttle that stays': Work(
        'class Relay:\n    m = 0.0\n    def relay(self, x, z):\n        self.m += 0.1 * x\n'
        '        return [self.m, 0.3 * z]\n',
        18.8, 'after the release of up motor is still +4 m/s²',
    ),
    'slow': Work(
        replaced(ROS_1, 'dt=0.05', 'dt=0.2'), 18.5,
        '5 commands a second while a key is held: the lab asks for one every 0.05 s',
    ),
    'without a sleep': Work(
        replaced(ROS_1, 'self.rate.sleep()', 'pass'), 18.5,
        '1000 commands a second while a key is held: is the sleep of its loop missing?',
    ),
    'another topic': Work(
        replaced(ROS_2, "'ecu'", "'ecu_pwm'"), 0, "publishes nothing on ecu, but on 'ecu_pwm'"
    ),
    'without a spin': Work(
        replaced(CALLBACK, 'rospy.spin()', ''), 0, 'nothing on ecu: is its spin missing?'
    ),
    'not finite': Work(
        replaced(FUNCTION, '2.0 * linear_x', 'float("inf") * linear_x'), 0,
        'relay.py, line 1: relay(linear_x=0.0, angular_z=0.0) returned [nan, 0.0]',
    ),
    'error': Work(
        replaced(ROS_2, 'twist.angular.z', 'twist.angle.z'), 0,
        "line 18: after 1.00 s the relay raised AttributeError: 'Twist' object has no attribute",
    ),
    'syntax error': Work(
        replaced(FUNCTION, 'angular_z):', 'angular_z)'), 0, 'relay.py, line 1: syntax error'
    ),
}  # fmt: skip


def findings_on(part: str, text: str) -> list[Finding]:
    return judged_file(part, FILES[part], text, Settings())[0]


#: Those that are judged in their process, too.
CONFINED = (
    *('function', 'program of ROS 2', "the lab's, which keeps the last key"),
    *('keyboard and relay in one node', 'node with a thread'),
)


@pytest.mark.usefixtures('confinement')
@pytest.mark.parametrize('kind', CONFINED)
def test_a_confined_relay_gets_the_same_points(tmp_path: Path, kind: str) -> None:
    (tmp_path / 'relay.py').write_text(WORKS[kind].text, encoding='utf-8')
    settings = Settings(criteria=tuple(RELAY))
    findings = HILLS.judge_folder(tmp_path, settings, ProcessLimits()).findings
    assert findings == findings_on('relay', WORKS[kind].text)


@pytest.mark.parametrize('kind', WORKS)
def test_a_relay_gets_its_points_and_sentence(kind: str) -> None:
    expected = WORKS[kind]
    finding_of = {each.criterion: each for each in findings_on('relay', expected.text)}
    faults = [each.message for each in finding_of.values() if not each.passed]
    assert expected.sentence in (faults or [''])[0]
    assert bool(faults) == bool(expected.sentence)

    rubric = load_rubric()
    worth = [rubric.points[each.criterion] for each in finding_of.values() if each.open]
    assert sum(worth) == expected.still_open
    assert sum(map(rubric.points_for, finding_of.values())) == pytest.approx(expected.points)


def test_without_task_3_the_points_are_of_100_and_with_it_of_120() -> None:
    texts = {'model': MODEL, 'controller': CONTROLLER}
    of_tasks_1_and_2 = [each for part, text in texts.items() for each in findings_on(part, text)]
    for relay, points in ((None, 100.0), (TEMPLATE, 100.0), (ROS_2, 120.0)):
        if relay is None:
            task_3 = [Finding(name, 0.0, 'there is none', skipped=True) for name in RELAY]
        else:
            task_3 = findings_on('relay', relay)
        rubric, findings = load_rubric(), [*of_tasks_1_and_2, *task_3]
        worth = rubric.worth(findings)
        total = sum(rubric.points_for(each) for each in findings if each.criterion in worth)
        assert (total, sum(worth.values())) == (points, points)


def test_rubric_can_require_task_3(tmp_path: Path) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text('criteria:\n  model.x: 10\n  relay.forward: 5\n', encoding='utf-8')
    rubric = load_rubric(file)
    missing = [Finding(name, 0.0, 'there is none', skipped=True) for name in HILLS.labels]
    assert (sum(rubric.points.values()), sum(rubric.worth(missing).values())) == (15.0, 15.0)
