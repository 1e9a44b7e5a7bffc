"""The vehicle on its road: what is observed of a state, and how it goes on."""

from __future__ import annotations

from math import radians
from typing import Any

import pytest

from barc_sim.errors import UserError
from barc_sim.vehicle.actuators import Actuator, ActuatorState
from barc_sim.vehicle.bicycles import DynamicBicycle, KinematicBicycle, LateralParameters
from barc_sim.vehicle.bike_model import Command, State, Vehicle, bikeFE, motion, step, surroundings
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.sensor import MeasurementError, NoiseLevels

HILL = Road((0.0, 20.0), (5.0, -7.0))
VEHICLE = Vehicle(mass=1000.0, air_drag_coeff=2.0, friction=30.0, l_f=1.1, l_r=1.9, gravity=9.0)
STATE = State(x=25.0, y=1.0, psi=0.3, v=6.0)
SLOW = Actuator(delay=0.13, lag=0.2, rate=5.0, limit=4.0)
#: All that is off by default.
ALL_ON: dict[str, Any] = {
    'motor': SLOW,
    'servo': SLOW,
    'integrator': 'rk4',
    'dynamics': 'dynamic',
    'lateral': LateralParameters(dynamic_above=5.0),
}


def plant_at(state: State, *, noise: NoiseLevels | None = None, seed: int = 0) -> Plant:
    plant = Plant(road=HILL, vehicle=VEHICLE, ts=0.05, noise=noise, seed=seed)
    plant.state = state
    return plant


def test_observation_has_road_and_forces_where_the_vehicle_is() -> None:
    seen = plant_at(STATE).observe()
    assert seen.surroundings.theta == -7.0
    assert seen.surroundings == surroundings(6.0, HILL.at(25.0), VEHICLE)


@pytest.mark.parametrize(('x', 'grade_deg'), [(19.9, 5.0), (20.0, -7.0)])
def test_step_is_taken_on_the_grade_where_it_begins(x: float, grade_deg: float) -> None:
    begin = STATE._replace(x=x)
    plant = plant_at(begin)
    plant.advance(Command(2.0, 0.1))
    assert plant.state == step(begin, Command(2.0, 0.1), radians(grade_deg), VEHICLE, 0.05)


def test_last_command_holds_until_the_next() -> None:
    held, repeated = plant_at(STATE), plant_at(STATE)
    held.advance(Command(2.0, 0.1))
    held.advance()
    repeated.advance(Command(2.0, 0.1))
    repeated.advance(Command(2.0, 0.1))
    assert held.state == repeated.state
    held.advance(Command(0.0, 0.0))
    repeated.advance(Command(0.0, 0.0))
    assert held.state == repeated.state


def test_another_model_is_stepped_in_the_place_of_the_labs() -> None:
    def backwards(x: float, *arguments: float, **_: float) -> list[float]:
        return [x - 1.0, *arguments[:3]]

    plant = Plant(model=backwards)

    plant.advance()
    plant.advance()

    assert plant.state == State(-2.0, 0.0, 0.0, 0.0)


# Actuators


@pytest.mark.parametrize('integrator', ['euler', 'rk4'])
def test_step_holds_the_mean_of_what_the_actuators_do(integrator: str) -> None:
    plant = Plant(
        road=HILL, vehicle=VEHICLE, ts=0.05, motor=SLOW, servo=SLOW, integrator=integrator
    )
    motor, servo, bicycle = (
        ActuatorState(SLOW, 0.05),
        ActuatorState(SLOW, 0.05),
        KinematicBicycle(integrator),
    )
    state = plant.state = STATE
    for k in range(30):
        command = Command(4.0 - k / 5.0, 0.01 * k)
        held = Command(motor.advance(command.motor), servo.advance(command.servo))
        state = bicycle.step(state, held, lambda x: radians(HILL.grade_deg(x)), VEHICLE, 0.05)
        plant.advance(command)
        assert plant.state == state


def test_velocities_are_observed_under_the_steering_that_acts_not_under_the_command() -> None:
    plant = Plant(servo=Actuator(delay=0.02, rate=1.0))
    plant.state = State(v=6.0)
    told = []
    for _ in range(3):
        plant.advance(Command(0.0, 0.3))
        seen = plant.observe()
        assert seen.true == motion(plant.state, seen.acting.servo, plant.vehicle)
        told.append(seen.acting.servo)
    assert told == pytest.approx([0.0, 0.02, 0.04])


def test_placed_car_has_no_command_on_its_way() -> None:
    plant, fresh = Plant(**ALL_ON), Plant(**ALL_ON)
    for _ in range(50):
        plant.advance(Command(4.0, 0.2))
    for car in (plant, fresh):
        car.place(State(x=1.0, v=9.0))
        assert car.observe().acting == Command()
    for _ in range(20):
        plant.advance(Command())
        fresh.advance(Command())
        assert plant.observe() == fresh.observe()


# Braking, whatever is on


@pytest.mark.parametrize('on', [{}, ALL_ON, ALL_ON | {'integrator': 'euler'}])
@pytest.mark.parametrize(('x', 'v'), [(10.0, 6.0), (10.0, -6.0), (25.0, 6.0), (25.0, -3.0)])
def test_brake_stops_the_car_whatever_is_on(on: dict[str, Any], x: float, v: float) -> None:
    plant = Plant(road=HILL, vehicle=VEHICLE, ts=0.02, **on)
    for _ in range(20):
        plant.advance(Command(4.0, 0.1))
    plant.state = State(x=x, v=v)
    speeds = []
    for _ in range(100):
        plant.brake(8.0)
        speeds.append(plant.state.v)
    assert all(speed * v >= -1e-12 for speed in speeds)
    assert speeds[-1] == pytest.approx(0.0, abs=1e-12)
    still = plant.state
    plant.brake(8.0)
    assert plant.state == pytest.approx(still, abs=1e-12)


# Integrator and dynamics


def test_dynamic_car_has_its_own_velocities() -> None:
    plant = Plant(road=Road.flat(), dynamics='dynamic', noise=NoiseLevels(v_y=0.1))
    plant.state = state = State(v=20.0)
    bicycle = DynamicBicycle()
    for _ in range(20):
        plant.advance(Command(0.0, 0.05))
        state = bicycle.step(state, Command(0.0, 0.05), lambda _: 0.0, Vehicle(), 0.02)
    seen = plant.observe()
    assert seen.true == bicycle.motion(state, 0.05, Vehicle())
    assert seen.true.psi_dot != pytest.approx(motion(state, 0.05, Vehicle()).psi_dot, rel=0.05)
    assert seen.measured == seen.true._replace(v_y=seen.true.v_y + seen.error.v_y)
    assert seen.error.v_y != 0.0
    assert seen.surroundings == surroundings(state.v, plant.road.at(state.x), Vehicle())


def own_model(*arguments: float, **keywords: float) -> list[float]:
    return bikeFE(*arguments, **keywords)


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        ({'integrator': 'heun'}, "^integrator 'heun' must be 'euler' or 'rk4'$"),
        ({'dynamics': 'dynamical'}, "^dynamics 'dynamical' must be 'kinematic' or 'dynamic'$"),
        ({'model': own_model, 'integrator': 'rk4'}, "^integrator 'rk4' does not go with a model"),
        ({'model': own_model, 'dynamics': 'dynamic'}, "^dynamics 'dynamic' takes the place of a"),
        ({'dynamics': 'dynamic', 'ts': 0.1}, '^steps of 0.1 s are too long for the dynamic bicyc'),
    ],
)
def test_what_does_not_go_together_is_refused(options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(UserError, match=sentence):
        Plant(**options)


def test_noise_can_be_turned_on_between_two_steps() -> None:
    plant = Plant(seed=3)
    assert plant.observe().error == MeasurementError()
    plant.sensor.noise = NoiseLevels(v_x=0.5)
    noisy = plant.observe()
    assert noisy.error == Plant(seed=3, noise=NoiseLevels(v_x=0.5)).observe().error
    assert noisy.measured.v_x == noisy.true.v_x + noisy.error.v_x != noisy.true.v_x


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
        assert not plant.has_fast_path


def test_a_disturbance_is_that_of_the_time_and_the_place() -> None:
    asked = []
    plant = Plant(ts=0.5, disturbance=lambda t, x: asked.append((t, x)) or 0.0)  # type: ignore[func-returns-value]
    for _ in range(3):
        plant.advance(Command(2.0))
    assert asked == [(0.0, 0.0), (0.5, 0.0), (1.0, pytest.approx(0.5, abs=1e-4))]
