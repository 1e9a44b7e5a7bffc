"""User code in the places of barc_sim's own."""

from __future__ import annotations

import pickle
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pytest
from user_files import CONTROLLER, MODEL, load, load_folder, user_text

from barc_sim.control.driver import FULL_BRAKE, DriverInput
from barc_sim.lab.user_code.adapters import (
    UserCommands,
    UserController,
    UserDriver,
    controller_of,
)
from barc_sim.simulation.closed_loop import closed_loop, simulate
from barc_sim.vehicle.plant import Plant

if TYPE_CHECKING:
    from pathlib import Path

    from barc_sim.lab.user_code.code import UserCode

PID = user_text('pid_with_calls.py')


def code_of(tmp_path: Path, name: str, text: str) -> UserCode:
    (tmp_path / name).write_text(text)
    return load(tmp_path / name)


@pytest.fixture
def controller(tmp_path: Path) -> UserController:
    """Return a user's controller that counts its calls."""
    return UserController(code_of(tmp_path, 'controller.py', PID))


@pytest.fixture
def reference(tmp_path: Path) -> Path:
    """Return a folder with barc_sim's own model and controller as a user's."""
    (tmp_path / 'bike_model.py').write_text(MODEL)
    (tmp_path / 'controller.py').write_text(CONTROLLER)
    return tmp_path


def test_the_references_own_folder_drives_the_reference_bit_for_bit(reference: Path) -> None:
    lab = load_folder(reference)
    assert lab.model
    controller = UserController(lab)
    controller.output_min, controller.output_max = -8.0, 8.0
    controller.reset()
    log, expected = closed_loop(Plant(model=lab.model), controller), closed_loop()
    for name in log.columns():
        assert np.array_equal(getattr(log, name), getattr(expected, name), equal_nan=True), name


def test_an_output_beyond_the_limit_is_cut_and_marked_saturated(controller: UserController) -> None:
    controller.output_min, controller.output_max = -8.0, 8.0
    assert controller.acc_calculate(8.0, 0.0, 0.02) == 8.0
    assert controller.saturated
    assert controller.acc_calculate(8.0, 8.0, 0.02) == 2.0
    assert not controller.saturated


def test_changed_gains_reach_the_object_with_its_state(controller: UserController) -> None:
    controller.acc_calculate(8.0, 7.0, 0.02)
    controller.kp = 2.0
    assert controller.acc_calculate(8.0, 7.0, 0.02) == 2.0 + 2.0


def test_a_reset_makes_a_fresh_object_with_the_present_gains(controller: UserController) -> None:
    controller.acc_calculate(8.0, 7.0, 0.02)
    controller.kp = 2.0
    controller.reset()
    assert controller.acc_calculate(8.0, 7.0, 0.02) == 2.0 + 1.0


def test_commands_over_time_are_asked_for_at_the_states_own_times(tmp_path: Path) -> None:
    """A sum of 300 intervals of 0.02 s is less than 6 s, and would make a command too many."""
    code = code_of(tmp_path, 'identify.py', 'command = lambda t: 1.0 if t < 6.0 else 0.0')
    commands = UserCommands(code)
    options = {'road': 'flat', 'distance': 0.0, 'max_duration': 7.0, 'acceleration_limit': 0.5}
    log = simulate(controller=commands, **options)  # type: ignore[arg-type]

    assert log.motor.tolist() == [0.5] * 300 + [0.0] * 51
    assert log.saturated.tolist() == [1.0] * 300 + [0.0] * 51
    assert np.isnan(log.reference).all()
    assert commands.gains == commands.terms == {}


def test_commands_are_cut_to_the_cars_limits(tmp_path: Path) -> None:
    driver = UserDriver(code_of(tmp_path, 'relay.py', 'relay = lambda x, z: (99 * x, 99 * z)'))
    driver.receive(DriverInput(forward=1.0, turn=1.0), 1.0)
    assert driver.command(1.1, 0.0) == (8.0, 0.5)


def test_the_brake_works_with_any_relay(tmp_path: Path) -> None:
    driver = UserDriver(code_of(tmp_path, 'relay.py', 'relay = lambda x, z: (4, 0)'))
    driver.receive(FULL_BRAKE, 1.0)
    assert driver.command(1.1, 10.0).motor == -8.0


def test_a_reset_makes_a_fresh_relay(tmp_path: Path) -> None:
    text = (
        'class Relay:\n    n = 0\n    def relay(self, x, z):\n'
        '        self.n += 1\n        return self.n, 0\n'
    )
    driver = UserDriver(code_of(tmp_path, 'relay.py', text))
    assert [driver.command(t, 0.0).motor for t in (0.0, 0.05)] == [1.0, 2.0]
    driver.reset()
    assert driver.command(0.1, 0.0).motor == 1.0


def test_a_file_as_a_value_reaches_other_processes(tmp_path: Path) -> None:
    code_of(tmp_path, 'controller.py', PID)
    value = pickle.loads(pickle.dumps(partial(controller_of, tmp_path / 'controller.py')))  # noqa: S301
    assert value().acc_calculate(8.0, 7.0, 0.02) == 31.0
    code_of(tmp_path, 'controller.py', PID.replace('+ self.calls', '+ 5.0'))
    assert value().acc_calculate(8.0, 7.0, 0.02) == 35.0
