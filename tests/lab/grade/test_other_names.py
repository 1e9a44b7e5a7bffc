"""A file under a name of the student's own is not judged, and named with the name to give it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from user_files import PLAIN_CONTROLLER, PLAIN_MODEL

from barc_sim.lab.confined.process import ProcessLimits
from barc_sim.lab.files import candidates
from barc_sim.lab.grade.grade import grade, load_rubric
from barc_sim.lab.judge import Settings
from barc_sim.lab.labs.hills import HILLS
from barc_sim.lab.submission import read_submission

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

KEYBOARD = "publisher = node.create_publisher(Twist, 'cmd_vel', 10)\n"
PLOT = 'import matplotlib.pyplot as plt\nplt.plot([1.0])\n'


@pytest.mark.parametrize('name', ['key_listener', 'teleop_control', 'my_keyboard'])
def test_a_relay_under_another_name_is_named_in_the_grade(
    folder: Callable[..., Path], name: str
) -> None:
    files = {'bike_model': PLAIN_MODEL, 'controller': PLAIN_CONTROLLER, 'plot': PLOT}
    path = folder(**files, **{name: KEYBOARD})
    graded = grade(read_submission(path), load_rubric(), ProcessLimits(confined=False))
    note = f'there is no relay.py: is it {name}.py? Then give it this name'
    assert note in graded.notes
    assert graded.score == 100.0


def test_a_model_under_another_name_is_named_in_its_criteria(folder: Callable[..., Path]) -> None:
    path = folder(controller=PLAIN_CONTROLLER, vehicle=PLAIN_MODEL, plot=PLOT)
    settings = Settings(criteria=['model.x', 'model.v'])
    findings = HILLS.judge_folder(path, settings, ProcessLimits(confined=False)).findings
    sentence = 'there is no bike_model.py: is it vehicle.py? Then give it this name'
    assert {each.message for each in findings} == {sentence}


def test_files_that_are_judged_or_handed_out_are_no_candidates() -> None:
    files = {
        'controller.py': b"topic = 'cmd_vel'",
        'compose.py': b"topic = 'cmd_vel'",
        'old/teleop.py': b"topic = 'cmd_vel'",
        'notes.txt': b'cmd_vel',
        'b.py': b"x = '/cmd_vel'",
        'a.py': b'class Relay:\n',
        'c.py': b'\xff relay = 1\n',
    }
    assert candidates(files, 'relay') == ['a.py', 'b.py']
    assert candidates(files, 'model') == []
