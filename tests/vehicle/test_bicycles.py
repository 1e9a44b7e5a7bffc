"""Integrators and both bicycles: against closed forms, and against one another."""

from __future__ import annotations

from itertools import pairwise
from math import atan2, atanh, cos, cosh, isfinite, log, log2, radians, sin, sqrt, tanh
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barc_sim.vehicle.bicycles import (
    INTEGRATORS,
    DynamicBicycle,
    KinematicBicycle,
    LateralParameters,
    rates,
)
from barc_sim.vehicle.bike_model import Command, Motion, State, Vehicle, motion

if TYPE_CHECKING:
    from collections.abc import Sequence

LAB_TS = 0.02
ODD_VEHICLE = Vehicle(mass=1700.0, air_drag_coeff=0.7, friction=90.0, l_f=1.1, l_r=1.9, gravity=3.7)
FREE = Vehicle(air_drag_coeff=0.0, friction=0.0)
speeds = st.floats(-30.0, 30.0)
properties = settings(deadline=None, derandomize=True)


def drive(state: State, held: Command, vehicle: Vehicle, steps: int, theta: float = 0.0) -> State:
    bicycle = KinematicBicycle('rk4')
    for _ in range(steps):
        state = bicycle.step(state, held, lambda _: theta, vehicle, LAB_TS)
    return state


def test_rk4_rolls_downhill_against_drag_as_the_closed_form_has_it() -> None:
    vehicle = Vehicle(mass=1000.0, air_drag_coeff=20.0, friction=50.0)
    pull = 1000.0 * 9.8 * sin(radians(10.0)) - 50.0
    terminal, rate = sqrt(pull / 20.0), sqrt(pull * 20.0) / 1000.0
    phase = atanh(3.0 / terminal)
    state = drive(State(v=3.0), Command(), vehicle, 200, radians(-10.0))
    assert state.v == pytest.approx(terminal * tanh(phase + rate * 4.0), rel=1e-10)
    way = terminal / rate * log(cosh(phase + rate * 4.0) / cosh(phase))
    assert state.x == pytest.approx(way, rel=1e-10)


def test_rk4_reads_the_grade_along_the_step() -> None:
    seen: list[float] = []

    def grade(x: float) -> float:
        seen.append(x)
        return 0.0

    KinematicBicycle('rk4').step(State(5.0, v=10.0), Command(), grade, FREE, LAB_TS)
    assert seen == pytest.approx([5.0, 5.1, 5.1, 5.2])


@properties
@given(v=st.floats(-1.0, 1.0), friction=st.floats(0.0, 1e6), a0=st.floats(0.0, 1e3))
def test_rk4_resistance_alone_never_reverses_the_car(v: float, friction: float, a0: float) -> None:
    vehicle = Vehicle(mass=2000.0, air_drag_coeff=a0, friction=friction)
    found = drive(State(v=v), Command(), vehicle, 1).v
    assert 0.0 <= found <= v or v <= found <= 0.0


# The integrators


def turned(name: str, steps: int) -> float:
    """Return the error of an oscillation after 2 s."""
    state: Sequence[float] = (1.0, 0.0)
    for _ in range(steps):
        state = INTEGRATORS[name](lambda at: (at[1], -at[0]), state, 2.0 / steps)
    return abs(complex(*state) - complex(cos(2.0), -sin(2.0)))


@pytest.mark.parametrize(('name', 'order'), [('euler', 1), ('rk4', 4)])
def test_error_falls_with_the_order(name: str, order: int) -> None:
    assert log2(turned(name, 256) / turned(name, 512)) == pytest.approx(order, abs=0.02)


# The dynamic bicycle

TS = 0.005
CAR = Vehicle(air_drag_coeff=0.0, friction=0.0)
ODD = Vehicle(mass=1573.0, air_drag_coeff=0.0, friction=0.0, l_f=1.1, l_r=1.58)
UNDERSTEERING = LateralParameters()
OVERSTEERING = LateralParameters(front_stiffness=160e3, rear_stiffness=120e3)
#: [rad] So small that the equations are the linear ones to about its square.
SMALL = 1e-4


def flat(_: float) -> float:
    return 0.0


def understeer_gradient(vehicle: Vehicle, lateral: LateralParameters) -> float:
    """Return K [rad s²/m] of Rajamani, section 3.3: steering (l_f + l_r)/R + K v²/R on a circle."""
    load = vehicle.mass / (vehicle.l_f + vehicle.l_r)
    return load * (vehicle.l_r / lateral.front_stiffness - vehicle.l_f / lateral.rear_stiffness)


def at_speed(bicycle: DynamicBicycle, vehicle: Vehicle, v: float, servo: float, t: float) -> Motion:
    """Return the motion after `t` seconds of constant steering, its speed held at `v`."""
    state = State(v=v)
    for _ in range(round(t / TS)):
        state = bicycle.step(state, Command(0.0, servo), flat, vehicle, TS)._replace(v=v)
    return bicycle.motion(state, servo, vehicle)


# Closed forms


@pytest.mark.parametrize('integrator', ['euler', 'rk4'])
@pytest.mark.parametrize(('vehicle', 'lateral'), [(CAR, UNDERSTEERING), (ODD, UNDERSTEERING)])
@pytest.mark.parametrize('v', [5.0, 20.0, 45.0])
def test_steady_state_has_the_gains_of_the_closed_form(
    integrator: str, vehicle: Vehicle, lateral: LateralParameters, v: float
) -> None:
    bicycle = DynamicBicycle(lateral, integrator)
    seen = at_speed(bicycle, vehicle, v, SMALL, 6.0)
    gain = v / (vehicle.l_f + vehicle.l_r + understeer_gradient(vehicle, lateral) * v**2)
    assert seen.psi_dot == pytest.approx(gain * SMALL, rel=1e-5)


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
    slopes = rates(Command(0.0, servo), flat, ODD, OVERSTEERING)((0, 0, 0, v, v_y, psi_dot))
    gain = ODD.mass * (v * slopes[3] + v_y * slopes[4]) + 4000.0 * psi_dot * slopes[5]
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
    slopes = rates(Command(1.5), lambda _: theta, vehicle, LateralParameters())(
        (0, 0, 1.0, 10.0, 0.0, 0.0)
    )
    assert slopes[3] == pytest.approx(1.5 - 9.8 * sin(theta) - (2.0 * 100.0 + 30.0) / 1000.0)
    assert slopes[4:] == (0.0, 0.0)


@pytest.mark.parametrize('integrator', ['euler', 'rk4'])
@settings(deadline=None, derandomize=True, max_examples=30)
@given(
    commands=st.lists(
        st.tuples(st.floats(-100.0, 100.0), st.floats(-1.5, 1.5)), min_size=1, max_size=6
    )
)
def test_car_that_spins_stays_finite(integrator: str, commands: list[tuple[float, float]]) -> None:
    bicycle, state = DynamicBicycle(OVERSTEERING, integrator), State(v=30.0)
    for command in commands:
        for _ in range(25):
            state = bicycle.step(state, Command(*command), flat, Vehicle(), 0.02)
            assert all(map(isfinite, bicycle.motion(state, command[1], Vehicle())))


# Low speed


@pytest.mark.parametrize('integrator', ['euler', 'rk4'])
@pytest.mark.parametrize('v', [-8.0, -1.0, 0.0, 2.0])
def test_slow_or_reversing_car_is_the_kinematic_one(integrator: str, v: float) -> None:
    bicycle, kinematic = DynamicBicycle(integrator=integrator), KinematicBicycle(integrator)
    held, state = Command(-0.5, 0.3), State(1.0, 2.0, 0.3, v)
    found = bicycle.step(state, held, flat, ODD, TS)
    assert found == kinematic.step(state, held, flat, ODD, TS)
    assert bicycle.motion(found, 0.3, ODD) == motion(found, 0.3, ODD)


def test_car_that_speeds_up_goes_over_without_a_jump() -> None:
    bicycle, state = DynamicBicycle(integrator='rk4'), State(v=2.9)
    seen = []
    for _ in range(200):
        state = bicycle.step(state, Command(1.0, 0.1), flat, CAR, TS)
        seen.append(bicycle.motion(state, 0.1, CAR)[3:])
    assert seen[0][0] < 3.0 < seen[-1][0]
    jumps = [max(abs(b - a) for a, b in zip(*pair, strict=True)) for pair in pairwise(seen)]
    assert max(jumps) < 0.02


def test_car_that_slows_down_ends_at_rest() -> None:
    bicycle, state = DynamicBicycle(), State(v=12.0)
    vehicle = Vehicle(friction=4000.0)
    for _ in range(3000):
        state = bicycle.step(state, Command(0.0, 0.1), flat, vehicle, TS)
        assert state.v >= 0.0
    assert state.v == 0.0
    assert bicycle.motion(state, 0.1, vehicle)[3:] == (0.0, 0.0, 0.0)
