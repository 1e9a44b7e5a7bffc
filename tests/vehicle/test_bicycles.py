"""Integrators and both bicycles: against closed forms, and against one another."""

from __future__ import annotations

from itertools import pairwise
from math import atan2, atanh, cos, cosh, isfinite, log, log2, radians, sin, sqrt, tanh
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barc_sim.interfaces.records import Command, VehicleState
from barc_sim.vehicle.bicycles import (
    Bicycle,
    LateralParameters,
    Slip,
    bicycle_motion,
    bicycle_of,
    bicycle_step,
    dynamic_rates,
)
from barc_sim.vehicle.bike_model import BicycleState, Vehicle, motion
from barc_sim.vehicle.road import LEVEL, Inclines

if TYPE_CHECKING:
    from collections.abc import Iterator

LAB_TS = 0.02
ODD_VEHICLE = Vehicle(mass=1700.0, air_drag_coeff=0.7, friction=90.0, l_f=1.1, l_r=1.9, gravity=3.7)
FREE = Vehicle(air_drag_coeff=0.0, friction=0.0)
speeds = st.floats(-30.0, 30.0)
properties = settings(deadline=None, derandomize=True)


def drive(
    state: BicycleState, command: Command, vehicle: Vehicle, steps: int, theta: float = 0.0
) -> BicycleState:
    bicycle = bicycle_of('kinematic', 'rk4', vehicle)
    hill = Inclines((0.0,), (theta,))
    for _ in range(steps):
        state, _ = bicycle_step(bicycle, state, Slip(), command, hill, 0, LAB_TS)
    return state


def test_rk4_rolls_downhill_against_drag_as_the_closed_form_has_it() -> None:
    vehicle = Vehicle(mass=1000.0, air_drag_coeff=20.0, friction=50.0)
    pull = 1000.0 * 9.8 * sin(radians(10.0)) - 50.0
    terminal_speed = sqrt(pull / 20.0)
    rate = sqrt(pull * 20.0) / 1000.0
    phase = atanh(3.0 / terminal_speed)
    speed = terminal_speed * tanh(phase + rate * 4.0)
    distance = terminal_speed / rate * log(cosh(phase + rate * 4.0) / cosh(phase))

    state = drive(BicycleState(v=3.0), Command(), vehicle, 200, radians(-10.0))

    assert state.v == pytest.approx(speed, rel=1e-10)
    assert state.x == pytest.approx(distance, rel=1e-10)


@pytest.mark.parametrize(
    ('is_held', 'weights'), [(False, [1.0, 4.0, 1.0]), (True, [6.0, 0.0, 0.0])]
)
def test_rk4_reads_the_incline_along_the_step_unless_it_is_held(
    is_held: bool, weights: list[float]
) -> None:
    # At the start, in the middle and at the end of the step.
    inclines = Inclines((0.0, 5.05, 5.15), (0.1, -0.2, 0.3), is_held)
    bicycle = bicycle_of('kinematic', 'rk4', FREE)
    after, _ = bicycle_step(
        bicycle, BicycleState(5.0, v=10.0), Slip(), Command(), inclines, 0, LAB_TS
    )
    sines = [sin(theta) for theta in inclines.thetas]
    mean = sum(weight * sine for weight, sine in zip(weights, sines, strict=True)) / 6.0
    assert after.v == pytest.approx(10.0 - LAB_TS * 9.8 * mean)


@properties
@given(v=st.floats(-1.0, 1.0), friction=st.floats(0.0, 1e6), a0=st.floats(0.0, 1e3))
def test_rk4_resistance_alone_never_reverses_the_car(v: float, friction: float, a0: float) -> None:
    vehicle = Vehicle(mass=2000.0, air_drag_coeff=a0, friction=friction)
    speed = drive(BicycleState(v=v), Command(), vehicle, 1).v
    assert 0.0 <= speed <= v or v <= speed <= 0.0


# The integrators


def error_on_circle(name: str, steps: int) -> float:
    """Return the error of a position on a circle, after 2 s."""
    bicycle = bicycle_of('kinematic', name, FREE)
    state = BicycleState(v=8.0)
    command = Command(0.0, 0.2)
    for _ in range(steps):
        state, _ = bicycle_step(bicycle, state, Slip(), command, LEVEL, 0, 2.0 / steps)

    begin = motion(BicycleState(v=8.0), 0.2, FREE)
    beta = atan2(begin.v_y, begin.v_x)
    radius = 8.0 / begin.psi_dot
    end = beta + 2.0 * begin.psi_dot
    x = radius * (sin(end) - sin(beta))
    y = radius * (cos(beta) - cos(end))
    return abs(complex(state.x - x, state.y - y))


@pytest.mark.parametrize(('name', 'order', 'steps'), [('euler', 1, 256), ('rk4', 4, 16)])
def test_error_falls_with_the_order(name: str, order: int, steps: int) -> None:
    order_of_error = log2(error_on_circle(name, steps) / error_on_circle(name, 2 * steps))
    assert order_of_error == pytest.approx(order, abs=0.02)


# The dynamic bicycle

TS = 0.005
CAR = Vehicle(air_drag_coeff=0.0, friction=0.0)
ODD = Vehicle(mass=1573.0, air_drag_coeff=0.0, friction=0.0, l_f=1.1, l_r=1.58)
UNDERSTEERING = LateralParameters()
OVERSTEERING = LateralParameters(front_stiffness=160e3, rear_stiffness=120e3)
#: [rad] So small that the equations are the linear ones to about its square.
SMALL = 1e-4


def understeer_gradient(vehicle: Vehicle, lateral: LateralParameters) -> float:
    """Return K [rad s²/m] of Rajamani, section 3.3: steering (l_f + l_r)/R + K v²/R on a circle."""
    load = vehicle.mass / (vehicle.l_f + vehicle.l_r)
    return load * (vehicle.l_r / lateral.front_stiffness - vehicle.l_f / lateral.rear_stiffness)


def at_speed(bicycle: Bicycle, v: float, servo: float, t: float) -> VehicleState:
    """Return the motion after `t` seconds of constant steering, its speed held at `v`."""
    state, slip = BicycleState(v=v), Slip()
    for _ in range(round(t / TS)):
        state, slip = bicycle_step(bicycle, state, slip, Command(0.0, servo), LEVEL, 0, TS)
        state = state._replace(v=v)
    return bicycle_motion(bicycle, state, slip, servo)


def drive_on_the_flat(
    bicycle: Bicycle, state: BicycleState, command: Command, duration: float
) -> Iterator[tuple[BicycleState, VehicleState]]:
    """Yield state and motion after each step on the flat, for `duration` [s]."""
    slip = Slip()
    for _ in range(round(duration / TS)):
        state, slip = bicycle_step(bicycle, state, slip, command, LEVEL, 0, TS)
        yield state, bicycle_motion(bicycle, state, slip, command.servo)


# Closed forms


@pytest.mark.parametrize('integrator', ['euler', 'rk4'])
@pytest.mark.parametrize(('vehicle', 'lateral'), [(CAR, UNDERSTEERING), (ODD, UNDERSTEERING)])
@pytest.mark.parametrize('v', [5.0, 20.0, 45.0])
def test_steady_state_has_the_gains_of_the_closed_form(
    integrator: str, vehicle: Vehicle, lateral: LateralParameters, v: float
) -> None:
    bicycle = bicycle_of('dynamic', integrator, vehicle, lateral)
    velocities = at_speed(bicycle, v, SMALL, 6.0)
    gain = v / (vehicle.l_f + vehicle.l_r + understeer_gradient(vehicle, lateral) * v**2)
    assert velocities.psi_dot == pytest.approx(gain * SMALL, rel=1e-5)


# Physics


@properties
@given(
    v=st.floats(4.0, 30.0),
    v_y=st.floats(-1.0, 1.0),
    psi_dot=st.floats(-0.5, 0.5),
    servo=st.floats(-0.3, 0.3),
)
def test_energy_changes_by_the_power_of_the_tyres_alone(
    v: float, v_y: float, psi_dot: float, servo: float
) -> None:
    bicycle = bicycle_of('dynamic', 'euler', ODD, OVERSTEERING)
    at = VehicleState(0.0, 0.0, 0.0, v, v_y, psi_dot)
    rates = dynamic_rates(bicycle, at, Command(0.0, servo), 0.0, 1.0)
    gain = ODD.mass * (v * rates.v_x + v_y * rates.v_y) + 4000.0 * psi_dot * rates.psi_dot
    front_y, rear_y = v_y + 1.1 * psi_dot, v_y - 1.58 * psi_dot
    front = 160e3 * (servo - atan2(front_y, v))
    rear = -120e3 * atan2(rear_y, v)
    across_front = front_y * cos(servo) - v * sin(servo)  # the wheel slides so, against `front`

    assert gain == pytest.approx(front * across_front + rear * rear_y, abs=1e-6)
    assert front * across_front <= 0.0
    assert rear * rear_y <= 0.0


def test_grade_resistance_and_command_act_along_the_car() -> None:
    vehicle = Vehicle(mass=1000.0, air_drag_coeff=2.0, friction=30.0)
    theta = radians(7.0)
    at = VehicleState(0.0, 0.0, 1.0, 10.0, 0.0, 0.0)
    rates = dynamic_rates(bicycle_of('dynamic', 'euler', vehicle), at, Command(1.5), theta, 1.0)
    assert rates.v_x == pytest.approx(1.5 - 9.8 * sin(theta) - (2.0 * 100.0 + 30.0) / 1000.0)
    assert (rates.v_y, rates.psi_dot) == (0.0, 0.0)


@pytest.mark.parametrize('integrator', ['euler', 'rk4'])
@settings(deadline=None, derandomize=True, max_examples=30)
@given(
    commands=st.lists(
        st.tuples(st.floats(-100.0, 100.0), st.floats(-1.5, 1.5)), min_size=1, max_size=6
    )
)
def test_car_that_spins_stays_finite(integrator: str, commands: list[tuple[float, float]]) -> None:
    bicycle = bicycle_of('dynamic', integrator, Vehicle(), OVERSTEERING)
    state = BicycleState(v=30.0)
    slip = Slip()
    for motor, servo in commands:
        for _ in range(25):
            state, slip = bicycle_step(bicycle, state, slip, Command(motor, servo), LEVEL, 0, 0.02)
            assert all(map(isfinite, bicycle_motion(bicycle, state, slip, servo)))


# Low speed


@pytest.mark.parametrize('integrator', ['euler', 'rk4'])
@pytest.mark.parametrize('v', [-8.0, -1.0, 0.0, 2.0])
def test_slow_or_reversing_car_is_the_kinematic_one(integrator: str, v: float) -> None:
    start = BicycleState(1.0, 2.0, 0.3, v)
    command = Command(-0.5, 0.3)
    dynamic = bicycle_of('dynamic', integrator, ODD)
    kinematic = bicycle_of('kinematic', integrator, ODD)

    (step,) = drive_on_the_flat(dynamic, start, command, duration=TS)

    assert [step] == [*drive_on_the_flat(kinematic, start, command, duration=TS)]
    state, velocities = step
    assert velocities == motion(state, command.servo, ODD)


def test_car_that_speeds_up_changes_to_tyres_without_a_jump() -> None:
    bicycle = bicycle_of('dynamic', 'rk4', CAR)
    steps = drive_on_the_flat(bicycle, BicycleState(v=2.9), Command(1.0, 0.1), duration=1.0)
    velocities = [velocity for _, velocity in steps]
    assert velocities[0].v_x < 3.0 < velocities[-1].v_x

    for before, after in pairwise(velocities):
        assert abs(after.v_x - before.v_x) < 0.02
        assert abs(after.v_y - before.v_y) < 0.02
        assert abs(after.psi_dot - before.psi_dot) < 0.02


def test_car_that_slows_down_ends_at_rest() -> None:
    bicycle = bicycle_of('dynamic', 'euler', Vehicle(friction=4000.0))
    steps = [*drive_on_the_flat(bicycle, BicycleState(v=12.0), Command(0.0, 0.1), duration=15.0)]
    assert all(state.v >= 0.0 for state, _ in steps)

    state, velocities = steps[-1]
    assert state.v == 0.0
    assert velocities.v_x == 0.0
    assert velocities.v_y == 0.0
    assert velocities.psi_dot == 0.0
