"""The plant: actuators, sensor, and the vehicle on its road."""

from __future__ import annotations

from math import cos, exp, inf, pi, radians, sin
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barc_sim.errors import UserError
from barc_sim.interfaces.records import Command, MeasurementError, VehicleState
from barc_sim.vehicle.bicycles import LateralParameters
from barc_sim.vehicle.bike_model import BicycleState, Vehicle, bikeFE, motion, step, surroundings
from barc_sim.vehicle.plant import (
    Actuator,
    NoiseLevels,
    Plant,
    Sensor,
    act,
    actuator_response,
    channel_of,
    move_actuators,
    queue_room,
    with_error,
)
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Sequence


TS = 0.02
properties = settings(deadline=None, derandomize=True, max_examples=50)
values = st.floats(-10.0, 10.0)
times = st.floats(1e-3, 10.0)
rates = st.floats(0.01, 100.0) | st.just(inf)
lags = st.floats(0.01, 10.0) | st.just(0.0)


def drive(actuator: Actuator, commands: list[float], ts: float = TS) -> list[tuple[float, float]]:
    """Return the mean over each step, and the value at its end."""
    channel = channel_of(actuator, ts)
    queue = [0.0] * queue_room(channel)
    steps = []
    value = 0.0
    for k, command in enumerate(commands):
        value, mean = act(channel, value, queue, k, command, ts)
        steps.append((mean, value))
    return steps


# Off


@properties
@given(motor=values, servo=values)
def test_an_ideal_actuator_acts_as_commanded(motor: float, servo: float) -> None:
    command = Command(motor, servo)
    plant = Plant()
    acting, held_command = move_actuators(plant.model, plant.now, plant.waiting, command, 0.0)
    # As text: not even the sign of a zero may change.
    assert repr(acting) == repr(held_command) == repr(command)


# Delay


@pytest.mark.parametrize('steps', [1, 2, 7])
def test_delay_of_whole_steps_shifts_the_commands(steps: int) -> None:
    commands = [float(k) for k in range(1, 20)]
    expected = [*[0.0] * steps, *commands][: len(commands)]
    assert drive(Actuator(delay=steps * TS), commands) == list(zip(expected, expected, strict=True))


@pytest.mark.parametrize('rate', [3.0, 7.0, 30.0, 60.0, 90.0])
@pytest.mark.parametrize('steps', [1, 3, 29])
def test_a_delay_of_whole_steps_stays_whole_in_spite_of_rounding(rate: float, steps: int) -> None:
    ts = round(1e9 / rate) / 1e9
    (*_, before), after = (drive(Actuator(delay=steps / rate), [1.0] * n, ts) for n in (steps, 40))
    assert before == (0.0, 0.0)
    assert set(after[steps:]) == {(1.0, 1.0)}


@pytest.mark.parametrize('steps', [0.25, 1.25, 3.75])
def test_delay_between_two_steps_acts_within_one(steps: float) -> None:
    (*before, within, after) = drive(Actuator(delay=steps * TS), [4.0] * (int(steps) + 2))
    assert all(step == (0.0, 0.0) for step in before)
    assert within == (pytest.approx(4.0 * (1.0 - steps % 1.0)), 4.0)
    assert after == (4.0, 4.0)


# Lag


def test_lag_follows_its_exponential_exactly() -> None:
    lag = 0.3
    for k, (mean, value) in enumerate(drive(Actuator(lag=lag), [2.0] * 50)):
        begin, end = k * TS, (k + 1) * TS
        assert value == pytest.approx(2.0 * (1.0 - exp(-end / lag)), rel=1e-12)
        integral = 2.0 * (TS + lag * (exp(-end / lag) - exp(-begin / lag)))
        assert mean == pytest.approx(integral / TS, rel=1e-9)


@properties
@given(value=values, target=values, lag=lags, rate=rates, first=times, second=times)
def test_response_does_not_depend_on_how_time_is_cut(
    value: float, target: float, lag: float, rate: float, first: float, second: float
) -> None:
    actuator = Actuator(lag=lag, rate=rate)
    middle, mean_1 = actuator_response(actuator, value, target, first)
    end, mean_2 = actuator_response(actuator, middle, target, second)
    whole, mean = actuator_response(actuator, value, target, first + second)
    assert end == pytest.approx(whole, abs=1e-9)
    assert mean_1 * first + mean_2 * second == pytest.approx(mean * (first + second), abs=1e-8)


# Limits


def test_rate_limit_is_a_ramp_to_the_command_and_ends_on_it() -> None:
    ends = [value for _, value in drive(Actuator(rate=10.0), [1.0] * 7)]
    assert ends == [*(pytest.approx(0.2 * k) for k in range(1, 5)), *[1.0] * 3]
    assert drive(Actuator(rate=10.0), [1.0])[0][0] == pytest.approx(0.1)


def test_a_command_beyond_the_limit_is_cut_in_both_directions() -> None:
    limited = drive(Actuator(limit=0.5), [0.3, 9.0, -9.0])
    assert limited == [(0.3, 0.3), (0.5, 0.5), (-0.5, -0.5)]


# Replaced while it works


@pytest.mark.parametrize(('before', 'after'), [(0, 3), (1, 4), (4, 1), (5, 0)])
def test_replaced_delay_counts_from_the_next_command(before: int, after: int) -> None:
    plant = Plant(motor=Actuator(delay=before * TS))
    for k in range(1, 11):
        plant.advance(Command(float(k)))
    plant.replace_actuators(Actuator(delay=after * TS), Actuator())
    acted = []
    for k in range(11, 21):
        plant.advance(Command(float(k)))
        acted.append(plant.acting.motor)

    # Where the delay grew, the command that acts now acts meanwhile.
    assert acted == [max(k - after, 10.0 - before) for k in range(11, 21)]


TRUE = VehicleState(x=30.0, y=-2.0, psi=0.7, v_x=8.0, v_y=0.3, psi_dot=-0.2)
NOISY = NoiseLevels(s=0.1, ey=0.2, epsi=0.03, v_x=0.4, v_y=0.05, psi_dot=0.06)

#: The second measurement's errors with standard deviations of 1 and seed 1.
PINNED = MeasurementError(
    s=-0.5369532353602852,
    ey=0.5811181041963531,
    epsi=0.36457239618607573,
    v_x=0.294132496655526,
    v_y=0.02842224131579679,
    psi_dot=0.5467129866124469,
)


def errors(sensor: Sensor, n: int) -> Sequence[MeasurementError]:
    return [sensor.measure(TRUE)[1] for _ in range(n)]


@pytest.mark.parametrize('sensor', [Sensor(), Sensor(NoiseLevels(), seed=7)])
def test_sensor_without_deviation_measures_the_truth(sensor: Sensor) -> None:
    for _ in range(3):
        # Compared as text: no error is to be -0.0, either.
        assert repr(sensor.measure(TRUE)) == repr((TRUE, MeasurementError()))


@properties
@given(psi=st.floats(-pi, pi), seed=st.integers(0, 2**53))
def test_error_is_measured_minus_true_in_the_true_vehicles_frame(psi: float, seed: int) -> None:
    true = TRUE._replace(psi=psi)
    measured, error = Sensor(NOISY, seed).measure(true)
    d_x, d_y = measured.x - true.x, measured.y - true.y

    assert error == pytest.approx(
        MeasurementError(
            s=d_x * cos(psi) + d_y * sin(psi),
            ey=d_y * cos(psi) - d_x * sin(psi),
            epsi=measured.psi - psi,
            v_x=measured.v_x - true.v_x,
            v_y=measured.v_y - true.v_y,
            psi_dot=measured.psi_dot - true.psi_dot,
        ),
        abs=1e-12,
    )


def test_errors_are_the_same_with_every_python_and_numpy() -> None:
    unit = NoiseLevels(1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    assert errors(Sensor(unit, 1), 2)[-1] == PINNED


def test_errors_that_are_drawn_at_once_are_those_of_single_measurements() -> None:
    sensor = Sensor(NOISY, 5)
    errors_at_once = sensor.errors(200)
    assert errors_at_once.tolist() == [[*each] for each in errors(sensor, 200)]


@pytest.mark.parametrize('off', MeasurementError._fields)
def test_turning_one_deviation_off_leaves_the_other_errors_as_they_were(off: str) -> None:
    all_on = errors(Sensor(NOISY, 3), 10)
    one_off = errors(Sensor(NOISY._replace(**{off: 0.0}), 3), 10)
    assert one_off == [error._replace(**{off: 0.0}) for error in all_on]


# Delay of the sensor


def at(k: int) -> VehicleState:
    return VehicleState(x=0.1 * k * k, y=-0.2 * k, psi=0.3 * k, v_x=10.0 * k, v_y=k, psi_dot=-k)


def measurements(sensor: Sensor, steps: range) -> list[tuple[VehicleState, MeasurementError]]:
    results = []
    for k in steps:
        results.append(sensor.measure(at(k)))
        sensor.remember(at(k))
    return results


@pytest.mark.parametrize(('delay', 'steps'), [(0.04, 2.0), (0.05, 2.5), (0.001, 0.05), (0.02, 1.0)])
def test_a_late_measurement_is_that_of_before(delay: float, steps: float) -> None:
    late = measurements(Sensor(delay=delay, ts=TS), range(40))
    assert late[0] == (at(0), MeasurementError())

    for k, (measured, error) in enumerate(late):
        if k > steps:
            share = steps % 1.0
            newer, older = at(k - int(steps)), at(k - int(steps) - 1)
            expected = [
                (1.0 - share) * new + share * old for new, old in zip(newer, older, strict=True)
            ]
            assert measured == pytest.approx(expected)
        true = at(k)
        again = with_error(true, error, cos(true.psi), sin(true.psi))
        assert measured == pytest.approx(again, abs=1e-9)


def test_noise_and_delay_of_a_sensor_add_up() -> None:
    noise = NoiseLevels(v_x=0.5)
    late = measurements(Sensor(noise, 3, delay=0.02, ts=TS), range(20))
    punctual = measurements(Sensor(noise, 3), range(20))
    for k in range(1, 20):
        assert late[k][0].v_x == at(k - 1).v_x + punctual[k][1].v_x


def test_a_sensors_delay_can_change_while_the_car_drives() -> None:
    sensor = Sensor(ts=TS)
    measurements(sensor, range(10))
    sensor.delay = 0.0
    sensor.delay = 0.04
    motions = [motion for motion, _ in measurements(sensor, range(10, 14))]
    assert motions == [at(10), at(10), at(10), at(11)]
    sensor.delay = 0.02
    assert sensor.measure(at(14))[0] == at(13)


def test_a_late_plant_measures_the_states_that_it_had() -> None:
    late, punctual = Plant(sensor_delay=0.06), Plant()
    true = []
    for _ in range(20):
        true.append(punctual.observe().true)
        observation = late.observe()
        assert observation == late.observe()
        assert observation.true == true[-1]
        assert observation.measured == true[max(len(true) - 4, 0)]
        for plant in (late, punctual):
            plant.advance(Command(3.0, 0.1))
    late.place(BicycleState(x=50.0))

    assert late.observe().measured == late.observe().true


HILL = Road((0.0, 20.0), (5.0, -7.0))
VEHICLE = Vehicle(mass=1000.0, air_drag_coeff=2.0, friction=30.0, l_f=1.1, l_r=1.9, gravity=9.0)
STATE = BicycleState(x=25.0, y=1.0, psi=0.3, v=6.0)
SLOW = Actuator(delay=0.13, lag=0.2, rate=5.0, limit=4.0)
#: All that is off by default.
ALL_ON: dict[str, Any] = {
    'motor': SLOW,
    'servo': SLOW,
    'integrator': 'rk4',
    'dynamics': 'dynamic',
    'lateral': LateralParameters(dynamic_above=5.0),
}


def plant_at(state: BicycleState, *, noise: NoiseLevels | None = None, seed: int = 0) -> Plant:
    plant = Plant(road=HILL, vehicle=VEHICLE, ts=0.05, noise=noise, seed=seed)
    plant.state = state
    return plant


def test_observation_has_road_and_forces_where_the_vehicle_is() -> None:
    observation = plant_at(STATE).observe()
    assert observation.surroundings.theta == -7.0
    assert observation.surroundings == surroundings(6.0, HILL.at(25.0), VEHICLE)


@pytest.mark.parametrize(('x', 'grade_deg'), [(19.9, 5.0), (20.0, -7.0)])
def test_step_is_taken_on_the_grade_where_it_begins(x: float, grade_deg: float) -> None:
    begin = STATE._replace(x=x)
    plant = plant_at(begin)
    plant.advance(Command(2.0, 0.1))
    assert plant.state == step(begin, Command(2.0, 0.1), radians(grade_deg), VEHICLE, 0.05)


def test_another_model_is_stepped_in_the_place_of_the_labs() -> None:
    def backwards(x: float, *arguments: float, **_: float) -> list[float]:
        return [x - 1.0, *arguments[:3]]

    plant = Plant(model=backwards)

    plant.advance(Command())
    plant.advance(Command())

    assert plant.state == BicycleState(-2.0, 0.0, 0.0, 0.0)


# Actuators


def test_velocities_are_observed_under_the_steering_that_acts_not_under_the_command() -> None:
    plant = Plant(servo=Actuator(delay=0.02, rate=1.0))
    plant.state = BicycleState(v=6.0)
    angles = []
    for _ in range(3):
        plant.advance(Command(0.0, 0.3))
        observation = plant.observe()
        assert observation.true == motion(plant.state, observation.acting.servo, plant.vehicle)
        angles.append(observation.acting.servo)

    assert angles == pytest.approx([0.0, 0.02, 0.04])


def test_a_placed_car_forgets_its_delayed_commands() -> None:
    plant, fresh = Plant(**ALL_ON), Plant(**ALL_ON)
    for _ in range(50):
        plant.advance(Command(4.0, 0.2))

    for car in (plant, fresh):
        car.place(BicycleState(x=1.0, v=9.0))
        assert car.observe().acting == Command()

    for _ in range(20):
        plant.advance(Command())
        fresh.advance(Command())
        assert plant.observe() == fresh.observe()


# Integrator and dynamics


def own_model(*arguments: float, **keywords: float) -> list[float]:
    return bikeFE(*arguments, **keywords)


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        ({'integrator': 'heun'}, "^integrator 'heun' must be 'euler' or 'rk4'$"),
        ({'dynamics': 'dynamical'}, "^dynamics 'dynamical' must be 'kinematic' or 'dynamic'$"),
        ({'model': own_model, 'integrator': 'rk4'}, "^integrator 'rk4' cannot be used with a mod"),
        (
            {'model': own_model, 'dynamics': 'dynamic'},
            "^dynamics 'dynamic' and a model of your own",
        ),
        (
            {'dynamics': 'dynamic', 'ts': 0.05},
            '^steps of 0.05 s are too long for the dyn',
        ),
        (
            {'dynamics': 'dynamic', 'integrator': 'rk4', 'ts': 0.06},
            '^steps of 0.06 s are too long for the dyn',
        ),
    ],
)
def test_options_that_contradict_each_other_are_refused(
    options: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(UserError, match=sentence):
        Plant(**options)


def test_rk4_makes_longer_steps_of_the_dynamic_bicycle_than_euler() -> None:
    plant = Plant(road=Road.flat(), dynamics='dynamic', integrator='rk4', ts=0.05)
    plant.place(BicycleState(v=3.1))
    for _ in range(400):
        plant.advance(Command(0.01, 0.1))
        assert abs(plant.motion().psi_dot) < 0.2


# Disturbance


@pytest.mark.parametrize('options', [{}, {'integrator': 'rk4'}, {'dynamics': 'dynamic'}])
def test_a_force_accelerates_by_its_share_of_the_mass(options: dict[str, str]) -> None:
    smooth = Vehicle(mass=1000.0, air_drag_coeff=0.0, friction=0.0)
    plants = [
        Plant(road=Road.flat(), vehicle=smooth, force=500.0, **options),  # type: ignore[arg-type]
        Plant(road=Road.flat(), vehicle=smooth, disturbance=lambda *_: 500.0, **options),  # type: ignore[arg-type]
    ]
    for plant in plants:
        for _ in range(100):
            plant.advance(Command(1.0))
        assert plant.state.v == pytest.approx(3.0)
    by_force, by_signal = plants
    assert by_force.has_fast_path

    assert not by_signal.has_fast_path


def test_a_disturbance_is_that_of_the_time_and_the_place() -> None:
    questions = []
    plant = Plant(ts=0.5, disturbance=lambda t, x: questions.append((t, x)) or 0.0)  # type: ignore[func-returns-value]
    for _ in range(3):
        plant.advance(Command(2.0))
    assert questions == [(0.0, 0.0), (0.5, 0.0), (1.0, pytest.approx(0.5, abs=1e-4))]
