"""What a page is told of a run's road."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barc_sim.control.lqr import LQR
from barc_sim.control.pid import speed_controller
from barc_sim.page.protocol import CAR, OTHERS, TUNABLE, driven_road, facts
from barc_sim.simulation.closed_loop import closed_loop, simulate
from barc_sim.simulation.metrics import summary
from barc_sim.vehicle.actuators import Actuator
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road


def test_a_road_that_the_simulator_names_is_told() -> None:
    told = facts('acc', {'road': 'lab', 'l_f': 1.25, 'l_r': 1.75}, {'kp': 3.0, 'mass': 1.0})
    assert told['road']['starts'][:3] == [0.0, 20.0, 40.0]
    assert told['axles'] == [-1.75, 1.25]
    assert told['tuning'] == {'kp': 3.0}


def test_sliders_and_terms_follow_from_the_controllers_declaration() -> None:
    told = facts('acc', {}, {'kp': 30.0, 'observer_gain': 0.5}, LQR)
    assert told['terms'] == ['feedback', 'compensation']
    assert [*told['sliders']] == [*LQR.gains, *OTHERS, *CAR]
    assert told['sliders']['observer_gain'] == {
        'label': 'Gain of the disturbance observer, observer_gain',
        'short': 'observer gain',
        'unit': '',
        'max': 1.0,
        'node': 'controller',
    }
    assert facts('acc', {}, {})['sliders']['kp']['label'] == 'Proportional gain, kp [1/s]'
    assert told['tuning'] == {'observer_gain': 0.5}


def test_presets_set_known_parameters_and_the_windup_alone_has_a_limit_of_the_motor() -> None:
    presets = facts('acc', {}, {})['presets']
    assert {name for values in presets.values() for name in values} <= TUNABLE.keys()
    assert [name for name, values in presets.items() if values['motor_limit']] == ['Windup']
    windup = presets['Windup']
    knows = {**windup, 'acceleration_limit': windup['motor_limit']}
    overshoots = []
    for values in (windup, knows):
        limit = values['acceleration_limit']
        controller = speed_controller(values['kp'], values['ki'], values['kd'], limit)
        log = closed_loop(Plant(motor=Actuator(limit=values['motor_limit'])), controller)
        overshoots.append(summary(log).overshoot)
    assert overshoots[0] > 0.5
    assert overshoots[1] < 0.1


def test_what_the_default_gains_leave_to_improve_is_true_and_within_the_sliders() -> None:
    told = facts('acc', {}, {})
    error = summary(simulate()).rms_error_after_run_up
    assert f'{error:.3f} m/s: kp and ki can halve it' in told['about']['Tuned']
    better = {'kp': 70.0, 'ki': 400.0, 'kd': 0.0}
    assert all(value <= told['sliders'][name]['max'] for name, value in better.items())
    assert summary(simulate(**better)).rms_error_after_run_up < 0.5 * error


@pytest.mark.parametrize('simulator', [{}, {'road': 'no/such/file.csv'}])
def test_a_road_that_is_not_known_here_is_left_out(simulator: dict[str, str]) -> None:
    assert facts('acc', simulator, {})['road'] is None


def test_road_value_needs_no_file() -> None:
    road = Road(starts=(0.0,), grades_deg=(3.0,), name='no/such/file.csv')
    found = facts('acc', {'road': road.name}, {}, road=road)
    assert found['road'] == {'starts': [0.0], 'grades_deg': [3.0]}


def test_the_road_of_a_run_is_the_one_that_it_drove_on() -> None:
    road = driven_road(closed_loop())
    assert road
    assert road.grades_deg == (0.0, 10.0, 0.0, -10.0, 0.0, 30.0, 0.0, -30.0, 0.0)
    np.testing.assert_allclose(road.starts, np.arange(0.0, 180.0, 20.0), atol=0.1)


def test_a_run_that_recorded_no_road_has_none() -> None:
    log = closed_loop(distance=3.0)
    assert driven_road(replace(log, theta_deg=np.full(len(log), np.nan))) is None
