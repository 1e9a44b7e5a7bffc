"""The command `barc regrade`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
from command_line import printed, refused
from made_bags import make, parameters
from user_files import CONTROLLER, MODEL

from barc_sim.__main__ import main as barc
from barc_sim.bags.writer import BagWriter
from barc_sim.control.driver import DriverInput
from barc_sim.lab.user_code import adapters
from barc_sim.lab.user_code.adapters import UserController
from barc_sim.lab.user_code.loading import load_files, load_folder
from barc_sim.simulation.closed_loop import closed_loop, drive_by_hand
from barc_sim.vehicle.plant import Plant

if TYPE_CHECKING:
    from pathlib import Path

    from barc_sim.lab.user_code.loading import UserCode

    Capture = pytest.CaptureFixture[str]

HALF = (
    'from helpers import half\n'
    'class PID:\n'
    '    def __init__(self, kp, ki, kd):\n        self.kp = kp\n'
    '    def acc_calculate(self, reference, current):\n'
    '        return half(self.kp * (reference - current))\n'
)


@pytest.fixture
def lab(tmp_path: Path) -> UserCode:
    """Return a user's model, which is right, and controller, which is another."""
    folder = tmp_path / 'lab'
    folder.mkdir()
    (folder / 'bike_model.py').write_text(MODEL)
    (folder / 'controller.py').write_text(HALF)
    (folder / 'helpers.py').write_text('def half(x):\n    return x / 2\n')
    return load_folder(folder)


def bag_of(tmp_path: Path, lab: UserCode, **changed: bytes) -> Path:
    assert lab.model
    assert lab.controller
    controller = UserController(lab.controller)
    controller.output_min, controller.output_max = -8.0, 8.0
    controller.reset()
    log = closed_loop(Plant(model=lab.model), controller, distance=30.0)
    changes = {f'student/{name}.py': data for name, data in changed.items()}
    attachments = adapters.attachments(lab) | changes
    return make(tmp_path / 'bag', log, adapters.describe(lab), attachments)


def test_an_empty_bag_is_named_so(tmp_path: Path) -> None:
    path = tmp_path / 'bag'
    path.mkdir()
    BagWriter(path, metadata={'parameters': parameters()}).close()
    sentence = f'{str(path)!r} is empty: it has no states, nor any other message'
    assert sentence in refused('regrade', str(path))


def test_a_run_of_barc_sim_came_from_it(tmp_path: Path) -> None:
    out = printed('regrade', str(make(tmp_path / 'bag', closed_loop(distance=30.0))))
    assert 'model of barc_sim       yes, bit for bit' in out
    assert out.endswith('The bag could have come from barc_sim.\n')


def test_a_run_with_user_code_came_from_that(tmp_path: Path, lab: UserCode) -> None:
    out = printed('regrade', str(bag_of(tmp_path, lab)))
    assert 'model of bike_model.py       yes, bit for bit' in out
    assert 'controller of barc_sim       no: at ' in out
    assert 'controller of controller.py  yes, bit for bit' in out
    assert out.endswith('could have come from bike_model.py and controller.py.\n')


def test_a_changed_file_is_named(tmp_path: Path, lab: UserCode) -> None:
    bag = bag_of(tmp_path, lab, helpers=b'def half(x):\n    return x / 2.0\n')
    assert 'helpers.py: is not the file that the run had' in printed('regrade', str(bag), code=1)


def test_other_code_did_not_make_the_commands(tmp_path: Path, lab: UserCode) -> None:
    bag = bag_of(tmp_path, lab, helpers=b'def half(x):\n    return x / 2.01\n')
    out = printed('regrade', str(bag), code=1)
    assert 'controller of controller.py  no: at ' in out
    assert out.endswith('could not have come from bike_model.py and controller.py.\n')


@pytest.mark.slow
def test_code_that_sleeps_in_each_call_ends_at_the_time_limit(
    tmp_path: Path, lab: UserCode
) -> None:
    sleepy = b'import time\ndef half(x):\n    time.sleep(0.3)\n    return x / 2\n'
    bag = bag_of(tmp_path, lab, helpers=sleepy)
    assert 'used up the 1 s' in printed('regrade', str(bag), '--time-limit', '1', code=1)


def test_code_that_fails_is_one_sentence(tmp_path: Path, lab: UserCode) -> None:
    assert 'ZeroDivisionError' in printed(
        'regrade', str(bag_of(tmp_path, lab, helpers=b'1 / 0\n')), code=1
    )


def test_what_was_found_can_be_had_as_json(tmp_path: Path, lab: UserCode) -> None:
    found = json.loads(printed('regrade', str(bag_of(tmp_path, lab)), '--json'))
    assert found['possible'] is True
    assert found['claimed'] == {'model': 'bike_model.py', 'controller': 'controller.py'}
    assert {(v['part'], v['code']) for v in found['verdicts']} == {
        ('model', 'barc_sim'),
        ('model', 'bike_model.py'),
        ('controller', 'barc_sim'),
        ('controller', 'controller.py'),
    }


def test_files_of_two_folders_are_kept_apart(tmp_path: Path) -> None:
    for name, source in (('one', MODEL), ('other', CONTROLLER)):
        (tmp_path / name).mkdir()
        (tmp_path / name / 'code.py').write_text(source)
    both = {'model': tmp_path / 'one' / 'code.py', 'controller': tmp_path / 'other' / 'code.py'}
    bag = bag_of(tmp_path, load_files(both))
    assert barc(['regrade', str(bag)]) == 0


def test_a_drive_by_hand_has_no_controller(tmp_path: Path) -> None:
    given = parameters({'road': 'flat', 'command_timeout': 0.5}, None)
    log = drive_by_hand([(0.0, DriverInput(forward=1.0, turn=0.5))], 2.0)
    assert 'controller' not in printed(
        'regrade', str(make(tmp_path / 'bag', log, {'parameters': given}))
    )


@pytest.mark.parametrize('text', ['', '[1]', '{a: 1}', 'a: {ros__parameters: {air_drag_coeff: x}}'])
def test_a_bag_without_its_parameters_is_refused(tmp_path: Path, text: str) -> None:
    bag = make(tmp_path / 'bag', closed_loop(distance=1.0), {'parameters': text})
    assert 'parameters of ' in refused('regrade', str(bag))


@pytest.mark.parametrize(
    'name', ['/etc/passwd', '../out.py', 'a/../../out.py', 'x' * 300, 'y/' * 50, 'bike_model.py/x']
)
def test_a_bag_cannot_write_elsewhere(tmp_path: Path, lab: UserCode, name: str) -> None:
    bag = bag_of(tmp_path, lab, **{name: b'x'})
    # The name ends in .py there; it leads out of the folder all the same.
    assert 'that no run attaches' in printed('regrade', str(bag), code=1)
