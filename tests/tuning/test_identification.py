"""Identification: parameters of simulated cars are found, and what a log cannot tell is said."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from barc_sim import Actuator, Road, Vehicle, identify, lap, simulate
from barc_sim.control.excitation import PRBS, SineSteer
from barc_sim.errors import UserError
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.vehicle.plant import NoiseLevels, Plant

if TYPE_CHECKING:
    from barc_sim.simulation.log import Log

pytest.importorskip('scipy')
CAR = Vehicle(friction=300.0, air_drag_coeff=0.8)
TRUTH = {
    'drag_per_mass': 0.8 / 2000.0,
    'friction_per_mass': 300.0 / 2000.0,
    'motor_delay': 0.11,
    'motor_lag': 0.08,
}


def drive(seed: int, duration: float = 6.0) -> Log:
    """Return the log of a car with `TRUTH`, and measured speeds."""
    plant = Plant(
        road=Road.flat(),
        vehicle=CAR,
        noise=NoiseLevels(v_x=0.03),
        seed=seed,
        motor=Actuator(delay=TRUTH['motor_delay'], lag=TRUTH['motor_lag']),
    )
    return closed_loop(plant, PRBS(amplitude=3.0), distance=1e9, max_duration=duration)


def test_resistance_and_motor_are_found_within_their_intervals() -> None:
    """Twice the interval of 95 % is four standard deviations."""
    found = identify(drive(seed=1))
    for name, true in TRUTH.items():
        assert abs(found[name].value - true) < 2.0 * found[name].interval, name
    assert found['motor_delay'].interval < 0.02
    assert found.whiteness['v_x'] > 0.001
    assert not any('delay' in remark for remark in found.remarks)


def test_a_log_without_noise_gives_the_delay_exactly() -> None:
    """It is no multiple of the step."""
    found = identify(simulate(controller=PRBS(), road='flat', distance=30.0, delay=0.053))
    assert found['motor_delay'].value == pytest.approx(0.053, abs=1e-5)
    assert np.isnan(found.whiteness['v_x'])
    assert str(found['motor_delay']).startswith('0.053 ± ')


def test_the_labs_own_resistance_cannot_be_told() -> None:
    """It is a hundred times too small, and the hills are known."""
    found = identify(simulate(noise=0.05, delay=0.1, distance=80.0))
    assert found['motor_delay'].value == pytest.approx(0.1, abs=0.002)
    for name in ('drag_per_mass', 'friction_per_mass'):
        assert any(remark.startswith(f'{name} cannot be identified') for remark in found.remarks)


def test_a_delay_that_no_command_shows_is_named() -> None:
    """A constant command does not show it."""
    log = drive(seed=1)
    log.motor[:] = 0.0
    found = identify(log)
    assert str(found['motor_delay']) == '-'
    assert any(remark.startswith('motor_delay cannot be identified') for remark in found.remarks)


@pytest.mark.slow
def test_a_car_at_rest_shows_nothing() -> None:
    found = identify(simulate(speed_reference=0.0, road='flat', distance=0.0, max_duration=10.0))
    assert [*map(str, found.estimates.values())] == ['-'] * 3
    assert 'no measured signal depends on it alone' in ''.join(found.remarks)


def test_tyres_and_yaw_inertia_are_found_where_the_car_steered() -> None:
    """Servo, too: the steering of this drive has a delay and a lag."""
    log = lap(
        SineSteer(),
        'L',
        speed=7.0,
        laps=1,
        dynamics='dynamic',
        noise=NoiseLevels(v_x=0.03, v_y=0.01, psi_dot=0.005),
        controller=PRBS(),
        vehicle=CAR,
        servo=Actuator(delay=0.07, lag=0.1),
    )
    found = identify(log)
    true = {
        'servo_delay': 0.07,
        'servo_lag': 0.1,
        'front_stiffness': 120e3,
        'rear_stiffness': 160e3,
        'yaw_inertia': 4000.0,
    }
    for name, value in true.items():
        assert abs(found[name].value - value) < 2.0 * found[name].interval, name
        assert found[name].interval < 0.05 * value, name


def test_a_car_that_steered_without_slip_has_no_tyres() -> None:
    """The kinematic bicycle, a run's default: all else is found."""
    noise = NoiseLevels(v_x=0.03, v_y=0.01, psi_dot=0.005)
    late = Actuator(delay=0.07, lag=0.1)
    log = lap(SineSteer(), 'oval', laps=1, noise=noise, controller=PRBS(), vehicle=CAR, servo=late)
    found = identify(log)
    true = {**TRUTH, 'motor_delay': 0.0, 'servo_delay': 0.07, 'servo_lag': 0.1}
    del true['motor_lag']
    assert found.estimates.keys() == true.keys()
    for name, value in true.items():
        assert abs(found[name].value - value) < 2.0 * found[name].interval, name
    assert 'tyres and yaw inertia are not seen: the car does not slip' in found.remarks


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_intervals_of_95_percent_hold_the_truth_that_often() -> None:
    """Over 20 seeds: fewer than 16 of 20 has a chance of 1 in 400."""
    found = [identify(drive(seed, 12.0)) for seed in range(20)]
    for name, true in TRUTH.items():
        inside = [abs(each[name].value - true) <= each[name].interval for each in found]
        assert sum(inside) >= 16, name


def test_a_log_of_another_car_says_that_the_model_is_not_enough() -> None:
    """Its motor is limited, which no parameter here says."""
    plant = Plant(road=Road.flat(), noise=NoiseLevels(v_x=0.03), motor=Actuator(limit=1.0))
    log = closed_loop(plant, PRBS(), distance=1e9, max_duration=4.0)
    assert any('not white noise' in remark for remark in identify(log).remarks)


def test_gaps_are_left_out() -> None:
    """A log that lacks a second gives two stretches; one that lacks most gives none."""
    log = drive(seed=4)
    t = log.t
    torn = log.map(lambda column: column[(t < 2.5) | (t > 3.0)])
    assert identify(torn)['motor_delay'].value == pytest.approx(0.11, abs=0.03)
    with pytest.raises(UserError, match='none of 1 logs has 2 s of states'):
        identify(log.map(lambda column: column[t < 1.0]))


def test_a_log_that_begins_in_motion_has_a_first_speed_of_its_own() -> None:
    """That of several is found with the parameters: the drag shows in each."""
    logs = [drive(seed, 8.0) for seed in (1, 2, 3)]
    parts = [log.map(lambda column, t=log.t: column[t > 2.0]) for log in logs]
    found = identify(*parts)
    for name, true in TRUTH.items():
        assert abs(found[name].value - true) < 2.0 * found[name].interval, name
    assert abs(np.mean(found.signals['v_x'][2] - found.signals['v_x'][1])) < 0.005


def test_a_command_that_missed_its_deadline_did_not_act() -> None:
    """The one before it held, as in a run in real time."""
    log = drive(seed=1)
    for k in (97, 157, 202):
        log.motor[k], log.missed[k] = -log.motor[k], True
    found = identify(log)
    for name, true in TRUTH.items():
        assert abs(found[name].value - true) < 2.0 * found[name].interval, name
    assert found.whiteness['v_x'] > 0.001


def test_a_return_to_the_start_begins_a_stretch() -> None:
    """A bag of two laps has no gap, but the car stands at the start of the second."""
    log = drive(seed=4)
    twice = log.map(lambda column: np.tile(column, 2))
    twice.t[len(log) :] += log.t[-1] + log.t[1]
    found, once = identify(twice)['motor_delay'], identify(log)['motor_delay']
    assert found.value == pytest.approx(once.value, abs=1e-4)
    assert found.interval < once.interval
