"""The kinematic bicycle's integrators: one is the lab's own, the other follows closed forms."""

from __future__ import annotations

from math import atanh, cosh, log, radians, sin, sqrt, tanh

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barc_sim.vehicle.bicycles import KinematicBicycle
from barc_sim.vehicle.bike_model import Command, State, Vehicle, slip_angle, step

TS = 0.02
ODD_VEHICLE = Vehicle(mass=1700.0, air_drag_coeff=0.7, friction=90.0, l_f=1.1, l_r=1.9, gravity=3.7)
FREE = Vehicle(air_drag_coeff=0.0, friction=0.0)
speeds = st.floats(-30.0, 30.0)
properties = settings(deadline=None, derandomize=True)


def drive(state: State, held: Command, vehicle: Vehicle, steps: int, theta: float = 0.0) -> State:
    bicycle = KinematicBicycle('rk4')
    for _ in range(steps):
        state = bicycle.step(state, held, lambda _: theta, vehicle, TS)
    return state


@properties
@given(v=speeds, motor=st.floats(-8.0, 8.0), servo=st.floats(-0.6, 0.6))
def test_euler_is_the_labs_step_to_the_last_bit(v: float, motor: float, servo: float) -> None:
    state, held = State(3.0, -1.0, 0.4, v), Command(motor, servo)
    found = KinematicBicycle().step(state, held, lambda x: 0.1 * x, ODD_VEHICLE, TS)
    assert found == step(state, held, 0.1 * 3.0, ODD_VEHICLE, TS)


def test_rk4_takes_a_circle_round() -> None:
    radius = 1.5 / sin(slip_angle(0.3))
    angle = 8.0 * 2.0 / radius
    beta = slip_angle(0.3)
    state = drive(State(v=8.0), Command(0.0, 0.3), FREE, 100)
    assert state.psi == pytest.approx(angle)
    centre = (-radius * sin(beta), radius * sqrt(1.0 - sin(beta) ** 2))
    distance = sqrt((state.x - centre[0]) ** 2 + (state.y - centre[1]) ** 2)
    assert distance == pytest.approx(radius, abs=1e-7)


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

    KinematicBicycle('rk4').step(State(5.0, v=10.0), Command(), grade, FREE, TS)
    assert seen == pytest.approx([5.0, 5.1, 5.1, 5.2])


@properties
@given(v=st.floats(-1.0, 1.0), friction=st.floats(0.0, 1e6), a0=st.floats(0.0, 1e3))
def test_rk4_resistance_alone_never_reverses_the_car(v: float, friction: float, a0: float) -> None:
    vehicle = Vehicle(mass=2000.0, air_drag_coeff=a0, friction=friction)
    found = drive(State(v=v), Command(), vehicle, 1).v
    assert 0.0 <= found <= v or v <= found <= 0.0
