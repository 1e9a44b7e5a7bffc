"""The bicycle against closed forms, symmetries and the physics of rolling to a standstill."""

from __future__ import annotations

from math import cos, pi, radians, sin

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from barc_sim.interfaces.records import Command
from barc_sim.vehicle.bike_model import BicycleState, Vehicle, bikeFE, motion, step, surroundings
from barc_sim.vehicle.road import Road, RoadPoint

TS = 0.02
MASS = 2000.0
FREE = {'a0': 0.0, 'm': MASS, 'Ff': 0.0}

#: Every value differs from every other, so that none can stand in for another.
ODD_VEHICLE = Vehicle(mass=1700.0, air_drag_coeff=0.7, friction=90.0, l_f=1.1, l_r=1.9, gravity=3.7)

positions = st.floats(-1e3, 1e3)
headings = st.floats(-pi, pi)
speeds = st.floats(-30.0, 30.0)
accelerations = st.floats(-8.0, 8.0)
steerings = st.floats(-0.6, 0.6)
inclines = st.floats(-0.6, 0.6)
properties = settings(deadline=None, derandomize=True)


def drive(
    duration: float,
    ts: float,
    *,
    v: float = 0.0,
    a: float = 0.0,
    theta: float = 0.0,
    vehicle: Vehicle = Vehicle(air_drag_coeff=0.0, friction=0.0),  # noqa: B008 (immutable)
) -> BicycleState:
    state = BicycleState(v=v)
    for _ in range(round(duration / ts)):
        state = step(state, Command(a), theta, vehicle, ts)
    return state


# Straight line


def test_straight_line_at_constant_acceleration_is_eulers_closed_form() -> None:
    v0, a, steps = 3.0, 1.7, 400
    state = drive(steps * TS, TS, v=v0, a=a)
    assert state.v == pytest.approx(v0 + a * steps * TS, rel=1e-12)
    assert state.x == pytest.approx(
        v0 * steps * TS + a * TS**2 * steps * (steps - 1) / 2, rel=1e-12
    )
    assert state.y == 0.0
    assert state.psi == 0.0


# Hills and resistance


@pytest.mark.parametrize('theta_deg', [-30.0, -10.0, 10.0, 30.0])
def test_speed_on_a_constant_grade_falls_with_gravity_along_the_road(theta_deg: float) -> None:
    theta = radians(theta_deg)
    state = drive(5.0, TS, v=20.0, theta=theta)
    assert state.v == pytest.approx(20.0 - 9.8 * sin(theta) * 5.0, rel=1e-12)


@properties
@given(
    v=speeds | st.floats(-1e-3, 1e-3),
    a=accelerations,
    theta=inclines,
    a0=st.floats(0.0, 1e3),
    friction=st.floats(0.0, 1e6),
)
@example(v=1e-9, a=-1e-6, theta=0.0, a0=0.0, friction=1e6)
def test_resistance_only_ever_slows_whatever_command_and_gravity_do(
    v: float, a: float, theta: float, a0: float, friction: float
) -> None:
    v_next = bikeFE(0.0, 0.0, 0.0, v, a, 0.0, a0, MASS, friction, theta, TS)[3]
    unresisted = bikeFE(0.0, 0.0, 0.0, v, a, 0.0, 0.0, MASS, 0.0, theta, TS)[3]
    if v > 0.0:
        assert min(unresisted, 0.0) <= v_next <= unresisted
    elif v < 0.0:
        assert unresisted <= v_next <= max(unresisted, 0.0)
    else:
        assert v_next == unresisted


# Symmetries


@properties
@given(y=positions, psi=headings, v=speeds, a=accelerations, d_f=steerings, theta=inclines)
def test_left_is_the_mirror_of_right(
    y: float, psi: float, v: float, a: float, d_f: float, theta: float
) -> None:
    left = step(BicycleState(1.0, y, psi, v), Command(a, d_f), theta, ODD_VEHICLE, TS)
    right = step(BicycleState(1.0, -y, -psi, v), Command(a, -d_f), theta, ODD_VEHICLE, TS)
    assert right == BicycleState(left.x, -left.y, -left.psi, left.v)


# The records over the same arithmetic


@properties
@given(psi=headings, v=speeds, d_f=steerings)
def test_motion_is_the_rate_of_change_seen_from_the_vehicle(
    psi: float, v: float, d_f: float
) -> None:
    state = BicycleState(1.0, 2.0, psi, v)
    velocities = motion(state, d_f, ODD_VEHICLE)
    after = step(state, Command(0.0, d_f), 0.0, ODD_VEHICLE, 1.0)
    d_x, d_y = after.x - state.x, after.y - state.y

    assert (velocities.x, velocities.y, velocities.psi) == (state.x, state.y, state.psi)
    assert velocities.v_x == pytest.approx(d_x * cos(psi) + d_y * sin(psi), abs=1e-9)
    assert velocities.v_y == pytest.approx(-d_x * sin(psi) + d_y * cos(psi), abs=1e-9)
    assert velocities.psi_dot == pytest.approx(after.psi - psi, abs=1e-9)


@properties
@given(v=speeds, theta=inclines)
def test_forces_sum_to_what_accelerates_the_vehicle(v: float, theta: float) -> None:
    assume(abs(v) > 1.0)
    after = step(BicycleState(v=v), Command(), theta, ODD_VEHICLE, TS)
    forces = surroundings(v, RoadPoint(0.0, sin(theta), 0.0), ODD_VEHICLE)
    total = forces.friction + forces.drag + forces.gravity
    assert total / ODD_VEHICLE.mass == pytest.approx((after.v - v) / TS, abs=1e-9)


@pytest.mark.parametrize(
    ('v', 'grade_deg', 'friction', 'drag', 'gravity'),
    [
        (3.0, 30.0, -7.0, -18.0, -500.0),
        (-3.0, -30.0, 7.0, 18.0, 500.0),
        (0.0, 30.0, 0.0, 0.0, -500.0),
    ],
)
def test_surroundings_have_the_grade_and_each_force(
    v: float, grade_deg: float, friction: float, drag: float, gravity: float
) -> None:
    vehicle = Vehicle(mass=100.0, air_drag_coeff=2.0, friction=7.0, gravity=10.0)
    forces = surroundings(v, Road((0.0,), (grade_deg,)).at(0.0), vehicle)
    assert forces.theta == pytest.approx(grade_deg)
    assert forces.elevation == 0.0
    assert forces.friction == pytest.approx(friction)
    assert forces.drag == pytest.approx(drag)
    assert forces.gravity == pytest.approx(gravity)
