"""A bad number is refused in one sentence: by Python, by a command, and by a node's parameter."""

from __future__ import annotations

from math import inf, nan
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

pytest.importorskip('rclpy')

from command_line import refused
from rclpy.node import Node
from rclpy.parameter import Parameter

from barc_sim import LQR, PID, Vehicle, simulate, sweep
from barc_sim.control.cruise_control import LIMIT, SPEED, gain_parameters
from barc_sim.control.pilots import as_pilot
from barc_sim.errors import UserError
from barc_sim.ros.parameters import declare
from barc_sim.simulation.scenario import LIMITS, Scenario
from barc_sim.simulation.stepper import parameters
from barc_sim.vehicle.bicycles import LateralParameters
from barc_sim.vehicle.plant import Actuator, NoiseLevels

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context

TABLE = [
    *parameters(),
    *gain_parameters(as_pilot(PID())),
    *gain_parameters(as_pilot(LQR())),
    LIMIT,
    SPEED,
]


def sentence(function: Callable[..., object], arguments: dict[str, Any]) -> str:
    with pytest.raises(UserError) as refusal:
        function(**arguments)
    name, colon, reason = str(refusal.value).partition(': ')
    assert (name, colon) in ((*arguments, ': '), ('kp', ': '))
    return reason


@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize(
    ('function', 'arguments', 'words'),
    [
        (simulate, {'acceleration_limit': -8}, 'acc --acceleration-limit -8'),
        (sweep, {'acceleration_limit': nan}, 'acc --acceleration-limit nan'),
        (simulate, {'kp': nan}, 'acc --kp nan'),
        (PID, {'kp': inf}, 'acc --kp inf'),
        (PID, {'kd': 1e7}, 'acc --gain kd=1e7 --no-bag'),
        (LQR, {'effort_weight': 0.0}, 'acc --gain effort_weight=0 --controller-type lqr --no-bag'),
        (simulate, {'speed_reference': 101}, 'acc --speed 101'),
        (sweep, {'speed_reference': 0.0}, 'tune --speed 0'),
        (simulate, {'distance': -1}, 'acc --distance -1'),
        (sweep, {'distance': 9.0}, 'tune --distance 9'),
        (simulate, {'noise': -1.0}, 'tune --noise -1'),
        (sweep, {'noise': inf}, 'tune --noise inf'),
        (simulate, {'seed': 1.5}, 'acc --seed 1.5'),
        (sweep, {'seed': -1}, 'tune --seed -1'),
        (simulate, {'seed': 'x'}, 'teleop --seed x'),
    ],
)
def test_a_command_refuses_a_value_with_the_sentence_of_python(
    function: Callable[..., object], arguments: dict[str, Any], words: str
) -> None:
    reason = sentence(function, arguments)
    _, option, value, *_ = words.split()
    name = value.partition('=')[0] if option == '--gain' else option
    assert f'{name}: {reason}' in refused(*words.split())


@pytest.mark.parametrize(
    ('function', 'arguments', 'parameter', 'value'),
    [
        (simulate, {'acceleration_limit': -8}, 'acceleration_limit', -8.0),
        (simulate, {'kp': nan}, 'kp', nan),
        (LQR, {'observer_gain': 1.5}, 'observer_gain', 1.5),
        (simulate, {'speed_reference': nan}, 'speed_reference', nan),
        (simulate, {'distance': 1e7}, 'distance', 1e7),
        (simulate, {'noise': -1}, 'noise_v_x', -1.0),
        (NoiseLevels, {'psi_dot': nan}, 'noise_psi_dot', nan),
        (simulate, {'delay': -1}, 'motor_delay', -1.0),
        (simulate, {'sensor_delay': 11}, 'sensor_delay', 11.0),
        (Actuator, {'lag': 101}, 'servo_lag', 101.0),
        (simulate, {'disturbance': nan}, 'disturbance', nan),
        (simulate, {'seed': 1.5}, 'seed', 1.5),
        (simulate, {'seed': -1}, 'seed', -1),
        (Vehicle, {'mass': -1}, 'mass', -1.0),
        (Vehicle, {'air_drag_coeff': inf}, 'air_drag_coeff', inf),
        (LateralParameters, {'yaw_inertia': 0}, 'yaw_inertia', 0.0),
    ],
)
def test_a_parameter_refuses_a_value_with_the_sentence_of_python(
    ros: Context,
    function: Callable[..., object],
    arguments: dict[str, Any],
    parameter: str,
    value: Any,  # noqa: ANN401
) -> None:
    reason = sentence(function, arguments)
    overrides = [Parameter(parameter, value=value)]
    node = Node('car', context=ros, parameter_overrides=overrides)
    with pytest.raises(UserError) as refusal:
        declare(node, (each for each in TABLE if each.name == parameter))
    assert str(refusal.value) == f'parameter {parameter} of car: {reason}'
    node.destroy_node()


@pytest.mark.usefixtures('ros_domain')
def test_a_missing_file_is_refused_with_the_sentence_of_python() -> None:
    with pytest.raises(UserError) as refusal:
        simulate(reference='nowhere.csv')
    assert str(refusal.value) in refused('acc', '--no-bag', '--reference', 'nowhere.csv')


@pytest.mark.parametrize('name', sorted(LIMITS.keys() - {'disturbance'}))  # which takes a file, too
@pytest.mark.parametrize('value', [nan, -inf, '1', None, True, [1.0]])
def test_every_field_refuses_a_value_that_is_not_a_number(name: str, value: object) -> None:
    reason = sentence(Scenario, {name: value})
    assert ' is not a ' in reason
    if name != 'laps':  # of `lap`
        assert sentence(simulate, {name: value}) == reason


@pytest.mark.parametrize(('ts', 'duration'), [(0.0, 600.0), (-0.02, 1.0), (0.02, inf), (2.0, 1.0)])
def test_a_step_or_a_duration_beyond_its_limits_is_refused(ts: float, duration: float) -> None:
    with pytest.raises(UserError, match='is not a number from'):
        simulate(ts=ts, max_duration=duration)


def test_numbers_of_numpy_are_taken_and_a_replaced_field_is_checked() -> None:
    assert simulate(seed=np.int64(3), noise=np.float32(0.5), distance=1.0) == simulate(
        seed=3, noise=0.5, distance=1.0
    )
    with pytest.raises(UserError, match='mass: -1 is not a number from 1 to'):
        simulate(vehicle=Vehicle()._replace(mass=-1.0))


@pytest.mark.usefixtures('ros_domain')
def test_a_speed_that_leads_away_from_the_distance_is_refused() -> None:
    with pytest.raises(UserError, match='speed_reference -5 leads away') as refusal:
        simulate(speed_reference=-5.0)
    assert str(refusal.value) in refused('acc', '--speed', '-5', '--no-bag')
    assert simulate(speed_reference=-5.0, distance=0.0, max_duration=2.0).speed[-1] < -4.0
