"""The vehicle on its road: what is observed of a state, and how it goes on."""

from __future__ import annotations

from math import radians

import pytest

from barc_sim.bike_model import Input, State, Vehicle, forces, motion, step
from barc_sim.plant import Plant
from barc_sim.road import Road
from barc_sim.sensor import Deviation, Sensor

HILL = Road((0.0, 20.0), (5.0, -7.0))
VEHICLE = Vehicle(mass=1000.0, air_drag_coeff=2.0, friction=30.0, l_f=1.1, l_r=1.9, gravity=9.0)
STATE = State(x=25.0, y=1.0, psi=0.3, v=6.0)


def plant_at(state: State, *, noise: Deviation | None = None, seed: int = 0) -> Plant:
    plant = Plant(road=HILL, vehicle=VEHICLE, ts=0.05, noise=noise, seed=seed)
    plant.state = state
    return plant


def test_plant_starts_at_rest_at_the_beginning_of_the_labs_road() -> None:
    plant = Plant()
    assert plant.state == State(0.0, 0.0, 0.0, 0.0)
    assert plant.road == Road.lab()
    assert plant.vehicle == Vehicle()
    assert plant.ts == 0.02


def test_observation_tells_road_and_forces_where_the_vehicle_is() -> None:
    seen = plant_at(STATE).observe()
    assert seen.theta_deg == -7.0
    assert seen.elevation == HILL.elevation(25.0)
    assert seen.forces == forces(6.0, radians(-7.0), VEHICLE)


def test_observation_without_noise_is_the_motion_and_no_error() -> None:
    seen = plant_at(STATE).observe()
    assert seen.measured == seen.true == motion(STATE, 0.0, VEHICLE)
    assert seen.error == Deviation()


def test_observing_does_not_change_the_state() -> None:
    plant = plant_at(STATE, noise=Deviation(s=1.0, v_x=1.0))
    plant.observe()
    assert plant.state == STATE


def test_each_observation_draws_new_noise_from_the_seed() -> None:
    noise = Deviation(s=1.0, v_x=0.5)
    plant, sensor = plant_at(STATE, noise=noise, seed=4), Sensor(noise, 4)
    for _ in range(3):
        seen = plant.observe()
        assert (seen.measured, seen.error) == sensor.measure(motion(STATE, 0.0, VEHICLE))


def test_default_seed_is_zero() -> None:
    noise = Deviation(s=1.0)
    assert Plant(noise=noise).observe() == Plant(noise=noise, seed=0).observe()


def test_noise_does_not_touch_road_and_forces() -> None:
    noisy, quiet = plant_at(STATE, noise=Deviation(s=9.0, v_x=9.0)), plant_at(STATE)
    seen, expected = noisy.observe(), quiet.observe()
    assert seen.true == expected.true
    assert seen[3:] == expected[3:]


@pytest.mark.parametrize(('x', 'grade_deg'), [(19.9, 5.0), (20.0, -7.0)])
def test_step_is_taken_on_the_grade_where_it_begins(x: float, grade_deg: float) -> None:
    begin = STATE._replace(x=x)
    plant = plant_at(begin)
    plant.advance(Input(2.0, 0.1))
    assert plant.state == step(begin, Input(2.0, 0.1), radians(grade_deg), VEHICLE, 0.05)


def test_last_command_holds_until_the_next() -> None:
    held, repeated = plant_at(STATE), plant_at(STATE)
    held.advance(Input(2.0, 0.1))
    held.advance()
    repeated.advance(Input(2.0, 0.1))
    repeated.advance(Input(2.0, 0.1))
    assert held.state == repeated.state
    held.advance(Input(0.0, 0.0))
    repeated.advance(Input(0.0, 0.0))
    assert held.state == repeated.state


def test_vehicle_without_a_command_coasts() -> None:
    plant = plant_at(STATE)
    plant.advance()
    assert plant.state == step(STATE, Input(0.0, 0.0), radians(-7.0), VEHICLE, 0.05)


def test_velocities_are_observed_under_the_steering_in_force() -> None:
    plant = plant_at(STATE)
    plant.advance(Input(0.0, 0.2))
    assert plant.observe().measured == motion(plant.state, 0.2, VEHICLE)


def test_replaced_vehicle_counts_from_the_next_step() -> None:
    plant = plant_at(STATE)
    plant.vehicle = Vehicle()
    assert plant.observe().forces == forces(6.0, radians(-7.0), Vehicle())
    plant.advance(Input(1.0))
    assert plant.state == step(STATE, Input(1.0), radians(-7.0), Vehicle(), 0.05)


@pytest.mark.parametrize(('x', 'v'), [(10.0, 6.0), (10.0, -6.0), (25.0, 6.0), (25.0, -3.0)])
def test_brake_stops_the_car_either_way_and_on_a_hill_without_reversing_it(
    x: float, v: float
) -> None:
    plant = plant_at(State(x=x, v=v))
    speeds = []
    for _ in range(60):
        plant.brake(8.0)
        speeds.append(plant.state.v)
    assert all(speed * v >= -1e-12 for speed in speeds)
    assert speeds[-1] == pytest.approx(0.0, abs=1e-12)
    still = plant.state.x
    plant.brake(8.0)
    assert plant.state.x == pytest.approx(still, abs=1e-12)


def test_brake_decelerates_at_its_limit_and_keeps_the_wheel() -> None:
    plant = plant_at(State(v=6.0))
    plant.advance(Input(servo=0.2))
    plant.state = State(v=6.0)
    plant.brake(3.0)
    assert plant.state == step(State(v=6.0), Input(-3.0, 0.2), radians(5.0), VEHICLE, 0.05)


def test_another_model_is_stepped_in_the_place_of_the_labs() -> None:
    def backwards(x: float, *arguments: float, **_: float) -> list[float]:
        return [x - 1.0, *arguments[:3]]

    plant = Plant(model=backwards)

    plant.advance()
    plant.advance()

    assert plant.state == State(-2.0, 0.0, 0.0, 0.0)
