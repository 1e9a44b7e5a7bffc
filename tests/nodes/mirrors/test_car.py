"""Where the car is in space, and how its wheels stand and roll."""

from __future__ import annotations

from math import atan, hypot, pi, sin, tan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barc_sim.nodes.mirrors.car import (
    WHEEL_RADIUS,
    Pose,
    Quaternion,
    acceleration,
    is_continuous,
    pose,
    wheels,
)
from barc_sim.vehicle.bike_model import Command, Motion, State, Vehicle, motion, step
from barc_sim.vehicle.road import Road

VEHICLE = Vehicle()
properties = settings(deadline=None, derandomize=True)
HILL = Road(starts=(0.0,), grades_deg=(30.0,))
grades = st.floats(-1.5, 1.5)
headings = st.floats(-7.0, 7.0)
servos = st.floats(-1.2, 1.2)
speeds = st.floats(-30.0, 30.0)


def rotated(turn: Quaternion, vector: tuple[float, float, float]) -> np.ndarray:
    """Return a vector of `base_link` as `odom` has it."""
    axis = np.array(turn[:3])
    twice = 2.0 * np.cross(axis, vector)
    return np.asarray(vector + turn.w * twice + np.cross(axis, twice))


def at(x: float = 0.0, y: float = 0.0, psi: float = 0.0, road: Road = HILL) -> Pose:
    return pose(Motion(x, y, psi, 0.0, 0.0, 0.0), road)


def test_nose_points_up_the_hill_and_down_it_after_a_half_turn() -> None:
    for psi, climb in ((0.0, 0.5), (pi, -0.5), (pi / 2.0, 0.0)):
        assert rotated(at(psi=psi).orientation, (1.0, 0.0, 0.0))[2] == pytest.approx(climb)


@properties
@given(s=st.floats(-10.0, 200.0), psi=headings, ds=st.floats(-0.5, 0.5))
def test_car_points_where_it_goes(s: float, psi: float, ds: float) -> None:
    road = Road.lab()
    here = at(s, 0.0, psi, road)
    there = at(s + ds * np.cos(psi), ds * np.sin(psi), psi, road)
    if here.theta == there.theta and all(
        road.grade_deg(s + part * ds * np.cos(psi)) == road.grade_deg(s) for part in (0.25, 0.5)
    ):
        way = rotated(here.orientation, (ds, 0.0, 0.0))
        assert np.subtract(there[:3], here[:3]) == pytest.approx(way, abs=1e-9)


@properties
@given(
    psi=headings,
    grade=st.floats(-80.0, 80.0),
    offset=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
)
def test_points_of_the_car_are_carried_as_its_orientation_says(
    psi: float, grade: float, offset: tuple[float, float, float]
) -> None:
    here = at(5.0, 1.0, psi, Road(starts=(0.0,), grades_deg=(grade,)))
    there = here[:3] + rotated(here.orientation, offset)
    assert here.to_odom(*offset) == pytest.approx(tuple(there), abs=1e-9)


@properties
@given(v=speeds, servo=servos)
def test_no_wheel_slips_sideways(v: float, servo: float) -> None:
    moving = motion(State(v=v), servo, VEHICLE)
    for wheel in wheels(moving, servo, VEHICLE):
        along = moving.v_x - moving.psi_dot * wheel.y
        across = moving.v_y + moving.psi_dot * wheel.x
        assert across * np.cos(wheel.steering) - along * np.sin(wheel.steering) == pytest.approx(
            0.0, abs=1e-9
        )
        assert abs(wheel.speed) * WHEEL_RADIUS == pytest.approx(hypot(along, across), abs=1e-9)


@properties
@given(v=speeds, servo=servos)
def test_left_and_right_mirror_each_other(v: float, servo: float) -> None:
    one = wheels(motion(State(v=v), servo, VEHICLE), servo, VEHICLE)
    other = wheels(motion(State(v=v), -servo, VEHICLE), -servo, VEHICLE)
    for i, j in ((0, 1), (1, 0), (2, 3), (3, 2)):
        assert one[i].steering == pytest.approx(-other[j].steering)
        assert one[i].speed == pytest.approx(other[j].speed)


def test_acceleration_on_a_circle_points_to_its_centre() -> None:
    servo, v = 0.3, 6.0
    moving = motion(State(v=v), servo, VEHICLE)
    x, y, psi = acceleration(moving, moving, 0.02)
    beta = atan(0.5 * tan(servo))
    assert hypot(x, y) == pytest.approx(v * v * sin(beta) / VEHICLE.l_r)
    assert x * moving.v_x + y * moving.v_y == pytest.approx(0.0)
    assert (y > 0.0, psi) == (True, 0.0)


@properties
@given(v=speeds, motor=st.floats(-8.0, 8.0), servo=servos, theta=grades)
def test_every_step_of_the_model_is_continuous(
    v: float, motor: float, servo: float, theta: float
) -> None:
    state = State(x=50.0, v=v)
    after = step(state, Command(motor, servo), theta, VEHICLE, 0.02)
    assert is_continuous(motion(state, servo, VEHICLE), motion(after, servo, VEHICLE), 0.02)


@pytest.mark.parametrize(
    ('before', 'dt'),
    [
        (State(x=100.0, v=8.0), 0.02),
        (State(x=100.0), 0.02),
        (State(x=1.0, v=8.0), 0.02),
        (State(), 0.0),
        (State(), -1.0),
    ],
)
def test_back_at_the_start_a_new_ride_begins(before: State, dt: float) -> None:
    start = motion(State(), 0.0, VEHICLE)
    assert not is_continuous(motion(before, 0.0, VEHICLE), start, dt)
