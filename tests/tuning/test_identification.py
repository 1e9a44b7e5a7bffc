"""Identification: parameters of simulated cars are found, and what a log cannot tell is said."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from barc_sim import PID, Actuator, Road, Vehicle, identify, lap, simulate
from barc_sim.control.excitation import PRBS, SineSteer, Steps
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


def plant_of_truth(ts: float) -> Plant:
    """Return a car with `TRUTH`, whose measurement has no noise."""
    motor = Actuator(delay=TRUTH['motor_delay'], lag=TRUTH['motor_lag'])
    return Plant(road=Road.flat(), vehicle=CAR, ts=ts, motor=motor)


class Held:
    """A controller that repeats each answer of another for some steps."""

    output_min, output_max = -np.inf, np.inf

    def __init__(self, law: PRBS, steps: int) -> None:
        self.law, self.steps = law, steps
        self.reset()

    def reset(self) -> None:
        """Begin again."""
        self.calls = 0
        self.law.reset()

    def acc_calculate(self, reference: float, speed: float, dt: float) -> float:
        """Return the other's answer, or its last one."""
        answer = self.law.acc_calculate(reference, speed, dt)
        if self.calls % self.steps == 0:
            self.answer = answer
        self.calls += 1
        return self.answer


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


def test_the_labs_resistance_is_too_small_to_be_identified() -> None:
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
def test_a_car_at_rest_gives_no_estimates() -> None:
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


def test_a_log_of_another_car_gives_a_warning_on_the_model() -> None:
    """Its motor is limited, which no parameter here says."""
    plant = Plant(road=Road.flat(), noise=NoiseLevels(v_x=0.03), motor=Actuator(limit=1.0))
    log = closed_loop(plant, PRBS(), distance=1e9, max_duration=4.0)
    assert any('not white noise' in remark for remark in identify(log).remarks)


@pytest.mark.parametrize('share', [0.01, 0.1])
def test_missing_rows_are_bridged(share: float) -> None:
    """The prediction continues, and a lost switch of the command is found: nearly as exact."""
    log = drive(seed=4, duration=12.0)
    whole = identify(log)
    kept = np.random.default_rng(1).random(len(log)) >= share
    found = identify(log.map(lambda column: column[kept]))
    for name, true in TRUTH.items():
        assert abs(found[name].value - true) < 2.0 * found[name].interval, name
        assert found[name].interval < 1.6 * whole[name].interval, name
    assert not found.remarks


@pytest.mark.parametrize('law', [PRBS(), Steps()])
def test_speeds_in_another_order_are_refused(law: PRBS | Steps) -> None:
    log = closed_loop(plant_of_truth(0.02), law, distance=1e9, max_duration=14.0)
    np.random.default_rng(2).shuffle(log.v_x)
    with pytest.raises(UserError, match=r'jumps by .* m/s from state to state'):
        identify(log)


def test_noise_in_a_steady_drive_does_not_count_as_a_jump() -> None:
    log = simulate(road='flat', noise=0.3, kp=0.1, ki=0.0, kd=0.0, distance=40.0)
    steady = log.map(lambda column: column[200:])
    assert identify(steady).estimates


@pytest.mark.parametrize('name', ['v_x', 'motor', 'servo', 'psi_dot'])
def test_a_value_beyond_all_cars_is_refused(name: str) -> None:
    log = drive(seed=1)
    getattr(log, name)[50] = -1e308
    with pytest.raises(UserError, match=rf'a value of {name} is -1e\+308 '):
        identify(log)


def test_a_ramp_of_the_command_does_not_count_as_a_switch() -> None:
    """A command that was lost while a PID accelerates the car lay between its neighbours."""
    motor = Actuator(delay=0.06, lag=0.1)
    plant = Plant(vehicle=CAR, noise=NoiseLevels(v_x=0.02), seed=101, motor=motor)
    log = closed_loop(plant, PID(kp=5.0, ki=2.0, kd=0.0), distance=40.0)
    kept = np.ones(len(log), np.bool_)
    kept[12] = False
    found = identify(log.map(lambda column: column[kept]))
    assert found['motor_delay'].value == pytest.approx(0.06, abs=0.0015)
    assert found['motor_lag'].value == pytest.approx(0.1, abs=0.002)


def test_lost_inclines_are_estimated() -> None:
    """Where a hill begins between two rows, the step of the speed is free."""
    log = simulate(controller=PRBS(), noise=0.02, delay=0.1, distance=70.0, vehicle=CAR)
    # Each hill's begin is lost, and the rows beside it.
    hills = np.flatnonzero(np.diff(log.theta_deg)) + 1
    kept = np.full(len(log), True)
    for row in hills:
        kept[row - 1 : row + 2] = False
    found = identify(log.map(lambda column: column[kept]))
    for name in ('friction_per_mass', 'motor_delay'):
        true = {**TRUTH, 'motor_delay': 0.1}[name]
        assert abs(found[name].value - true) < 2.0 * found[name].interval, name
    assert found.whiteness['v_x'] > 0.001


def test_after_a_long_gap_a_stretch_begins() -> None:
    """Its first second does not count, as earlier commands are unknown."""
    log = drive(seed=4)
    t = log.t
    torn = log.map(lambda column: column[(t < 2.5) | (t > 3.0)])
    found = identify(torn)
    assert found['motor_delay'].value == pytest.approx(0.11, abs=0.03)
    times, *_ = found.signals['v_x']
    assert not ((times > 2.5) & (times < 4.0)).any()
    with pytest.raises(UserError, match='none of 1 logs has 2 s of states'):
        identify(log.map(lambda column: column[t < 1.0]))


@pytest.mark.parametrize(('states', 'commands'), [(10, 3), (2, 3), (1, 7)])
def test_commands_act_from_their_own_time_on(states: int, commands: int) -> None:
    """They are faster than the states, which come at 10 Hz, or slower."""
    law = Held(PRBS(amplitude=3.0), commands)
    log = closed_loop(plant_of_truth(0.01), law, distance=1e9, max_duration=12.0)
    row = np.arange(len(log))
    noise = np.random.default_rng(3).normal(0.0, 0.02, len(log))
    theirs = replace(
        log,
        x=np.full(len(log), np.nan),
        v_x=np.where(row % states == 0, log.v_x + noise, np.nan),
        motor=np.where(row % commands == 0, log.motor, np.nan),
    )
    found = identify(theirs, integrator='rk4')
    for name, true in TRUTH.items():
        assert abs(found[name].value - true) < 2.0 * found[name].interval, name


def test_a_slow_motor_under_gentle_commands_is_estimated_right() -> None:
    """The error has another minimum at a long delay, without lag and with negative drag."""
    pid = PID(kp=2.0, ki=0.5, kd=0.0)
    pid.output_min, pid.output_max = -8.0, 8.0
    plant = Plant(
        vehicle=Vehicle(friction=400.0, air_drag_coeff=0.5),
        motor=Actuator(delay=0.25, lag=0.43),
        noise=NoiseLevels(v_x=0.02),
        seed=1,
    )
    found = identify(closed_loop(plant, pid, distance=180.0))
    assert found['motor_delay'].value == pytest.approx(0.25, abs=0.005)
    assert found['motor_lag'].value == pytest.approx(0.43, abs=0.005)
    assert found['drag_per_mass'].value == pytest.approx(0.00025, abs=1e-4)


@pytest.mark.parametrize('seed', [0, 3, 5])
@pytest.mark.parametrize('motor', [Actuator(delay=0.0249), Actuator(delay=0.0733, lag=0.21)])
def test_a_delay_does_not_stick_at_a_whole_step(seed: int, motor: Actuator) -> None:
    """The derivative of the error jumps there."""
    plant = Plant(
        road=Road.flat(),
        vehicle=Vehicle(friction=333.5, air_drag_coeff=0.6326),
        noise=NoiseLevels(v_x=0.02),
        seed=seed,
        motor=motor,
    )
    delay = identify(closed_loop(plant, Steps(), distance=100.0))['motor_delay']
    assert abs(delay.value - motor.delay) < 2.0 * delay.interval
    assert delay.interval < 0.01


@pytest.mark.parametrize('factor', [3.6, 0.1])
def test_wrong_units_are_named(factor: float) -> None:
    """A speed in km/h changes 3.6 times as much as one in m/s."""
    log = drive(seed=2, duration=8.0)
    found = identify(replace(log, v_x=factor * log.v_x))
    (remark,) = [each for each in found.remarks if 'times as much as was commanded' in each]
    found_factor = float(remark.removeprefix('the speed changes ').partition(' ')[0])
    assert found_factor == pytest.approx(factor, rel=0.15)
    assert 'expected v_x in m/s (in km/h it changes 3.6 times' in remark


def test_a_negative_friction_is_named() -> None:
    """The incline of this road has the wrong sign."""
    log = simulate(
        controller=PRBS(), noise=0.02, delay=0.1, distance=25.0, road=Road((0.0,), (1.0,))
    )
    found = identify(replace(log, theta_deg=2.0 * log.theta_deg))
    assert any(each.startswith('friction_per_mass is negative') for each in found.remarks)


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
