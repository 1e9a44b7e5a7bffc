"""What the controller's node computes: which states and references it takes, and its parameters."""

from __future__ import annotations

from math import inf, nan
from typing import TYPE_CHECKING, Any

import pytest

from barc_sim.control.cruise_control import CruiseControl
from barc_sim.control.excitation import SineSteer
from barc_sim.control.pilots import SpeedPilot
from barc_sim.control.speed import ACCELERATION_LIMIT, PID
from barc_sim.interfaces.records import VehicleState
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from barc_sim.interfaces.parameters import ParameterDeclaration


def defaults(table: list[ParameterDeclaration]) -> dict[str, Any]:
    return {each.name: each.default for each in table}


def moving(speed: float, x: float = 0.0, y: float = 0.0, psi: float = 0.0) -> VehicleState:
    """Return the motion of a car at this speed [m/s]."""
    return VehicleState(x, y, psi, speed, 0.0, 0.0)


@pytest.fixture
def refused() -> list[str]:
    return []


@pytest.fixture
def cruise(refused: list[str]) -> CruiseControl:
    def refuse(sentence: Callable[[], str]) -> None:
        refused.append(sentence())

    return CruiseControl(None, defaults, ACCELERATION_LIMIT, refuse, refuse)


@pytest.mark.parametrize('speed', [1e6, -1e6, 0.0])
def test_states_up_to_the_speed_limit_are_answered(cruise: CruiseControl, speed: float) -> None:
    answer = cruise.take_state(0, moving(speed))
    assert answer is not None
    assert answer.motor == (8.0 if speed <= 0.0 else -8.0)


@pytest.mark.parametrize('speed', [1.1e6, -1.1e6, nan, inf, -inf])
def test_states_beyond_the_speed_limit_are_refused(
    cruise: CruiseControl, refused: list[str], speed: float
) -> None:
    assert cruise.take_state(0, moving(speed)) is None
    assert refused == [f'a state whose speed is {speed} m/s']


@pytest.mark.parametrize('pose', [(nan, 0.0), (0.0, inf), (1e200, 0.0), (0.0, -1e200)])
def test_on_a_track_a_pose_that_is_nowhere_is_refused(
    refused: list[str], pose: tuple[float, float]
) -> None:
    """The square of its distance can be infinite."""

    def refuse(sentence: Callable[[], str]) -> None:
        refused.append(sentence())

    oval = Track.named('oval')
    cruise = CruiseControl(None, defaults, ACCELERATION_LIMIT, refuse, refuse, oval)
    assert cruise.take_state(0, moving(5.0, *pose)) is None
    assert refused == [f'a state at x={pose[0]}, y={pose[1]}, psi=0.0']
    assert cruise.take_state(0, moving(5.0, 1e6, -1e6)) is not None


@pytest.mark.parametrize('speed', [100.0, -100.0])
def test_a_reference_from_minus_100_to_100_is_held(
    cruise: CruiseControl, refused: list[str], speed: float
) -> None:
    cruise.hold_speed(speed)
    assert cruise.values['speed_reference'] == speed
    assert refused == []


@pytest.mark.parametrize('speed', [100.1, -100.1, nan])
def test_a_reference_beyond_100_is_refused(
    cruise: CruiseControl, refused: list[str], speed: float
) -> None:
    cruise.hold_speed(speed)
    assert cruise.values['speed_reference'] == 8.0
    assert len(refused) == 1


def test_parameters_are_a_pid_that_holds_8_meters_a_second(cruise: CruiseControl) -> None:
    assert isinstance(cruise.speed, SpeedPilot)
    assert isinstance(cruise.speed.controller, PID)
    assert (cruise.controller_type, cruise.lane_type) == ('pid', '')

    assert cruise.values == {
        'kp': 30.0,
        'ki': 200.0,
        'kd': 0.1,
        'acceleration_limit': 8.0,
        'speed_reference': 8.0,
        'reference': '',
    }
    assert [each.between for each in cruise.parameters()][:4] == [*[(-1e6, 1e6)] * 3, (0.01, 1e6)]


def test_time_that_goes_back_resets_the_controller(
    cruise: CruiseControl, refused: list[str]
) -> None:
    first = cruise.take_state(1_000_000_000, moving(7.75))
    assert cruise.take_state(1_020_000_000, moving(7.75)) != first
    assert cruise.take_state(1_000_000_000, moving(7.75)) == first
    assert refused == ['time went back by 0.02 s: the controller is reset']


def test_time_that_goes_back_resets_the_steering_law(refused: list[str]) -> None:
    def refuse(sentence: Callable[[], str]) -> None:
        refused.append(sentence())

    oval = Track.named('oval')
    cruise = CruiseControl(
        None, defaults, ACCELERATION_LIMIT, refuse, refuse, track=oval, lane=SineSteer()
    )
    first = cruise.take_state(1_000_000_000, moving(8.0))
    assert cruise.take_state(1_020_000_000, moving(8.0)) != first
    assert cruise.take_state(1_000_000_000, moving(8.0)) == first
    assert refused == ['time went back by 0.02 s: the controller is reset']


def test_a_reference_over_time_begins_with_the_first_state_and_ends_with_a_speed(
    tmp_path: Path,
) -> None:
    file = tmp_path / 'speed.csv'
    file.write_text('time_s,speed_mps\n0,4\n10,8\n', encoding='utf-8')

    def values(table: list[ParameterDeclaration]) -> dict[str, Any]:
        return {row.name: row.default for row in table} | {'reference': str(file)}

    cruise = CruiseControl(PID(), values, ACCELERATION_LIMIT, lambda _: None, lambda _: None)

    def speed_held(seconds: float) -> float:
        answer = cruise.take_state(round((1000.0 + seconds) * 1e9), moving(5.0))
        assert answer
        assert cruise.situation
        return cruise.situation.reference

    assert [speed_held(0.0), speed_held(5.0)] == [4.0, 6.0]
    cruise.reset()
    assert [speed_held(5.0), speed_held(10.0)] == [4.0, 6.0]
    cruise.hold_speed(3.0)
    assert speed_held(20.0) == 3.0
