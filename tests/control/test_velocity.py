"""Driving by velocity: the car reaches the speed and the yaw rate that are asked for, and stops."""

from __future__ import annotations

from math import atan, tan
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from barc_sim.control.driver import (
    COAST,
    FULL_BRAKE,
    PARAMETERS,
    DriverInput,
    Limits,
    VelocityDriver,
    make_driver,
)
from barc_sim.vehicle.bike_model import Command
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable

    from barc_sim.vehicle.plant import Observation

LIMITS = Limits()
WHEELBASE = 3.0
STEPS_PER_SECOND = 50
FINITE = st.floats(-1e300, 1e300)
Request = DriverInput | None  #: None: silence


def drive(
    asked: Callable[[float], Request],
    seconds: float,
    *,
    grade_deg: float = 0.0,
    driver: VelocityDriver | None = None,
) -> list[Observation]:
    """Drive on one grade; each command takes effect one step later. Return each step's state."""
    driver = driver or VelocityDriver()
    plant = Plant(road=Road((0.0,), (grade_deg,), name='one grade'))
    command = following = Command()
    seen = []
    for k in range(round(seconds * STEPS_PER_SECOND)):
        t = k / STEPS_PER_SECOND
        seen.append(plant.observe())
        if (2 * k) % 5 < 2:  # 20 of 50
            if (request := asked(t)) is not None:
                driver.receive(request, t)
            following = driver.command(t, seen[-1].measured.v_x)
        plant.advance(command)
        command = following
    return seen


@pytest.mark.parametrize(('v', 'omega'), [(3.0, 0.3), (3.0, -0.3), (-2.0, 0.2), (8.0, 0.1)])
def test_steady_speed_and_yaw_rate_are_those_asked_for(v: float, omega: float) -> None:
    driver = VelocityDriver()
    true = drive(lambda _: DriverInput(v, omega), 8.0, driver=driver)[-1].true
    assert driver.servo == pytest.approx(atan(WHEELBASE * omega / v))
    assert true.v_x == pytest.approx(v, abs=1e-4)
    assert true.psi_dot == pytest.approx(v * tan(driver.servo) / WHEELBASE, abs=1e-4)
    assert true.psi_dot == pytest.approx(omega, abs=1e-4)


def test_zero_twist_stops_the_car_without_rolling_back() -> None:
    seen = drive(lambda t: DriverInput(forward=13.83) if t < 6.0 else COAST, 12.0)
    speeds = [each.true.v_x for each in seen]
    assert speeds[6 * STEPS_PER_SECOND] == pytest.approx(13.83, abs=1e-3)
    assert speeds[8 * STEPS_PER_SECOND] < 0.05
    assert min(speeds) > -0.002
    assert abs(speeds[-1]) < 1e-4


def test_silence_stops_the_car_after_its_time() -> None:
    seen = drive(lambda t: DriverInput(forward=3.0) if t < 3.0 else None, 8.0)
    speeds = [each.true.v_x for each in seen]
    assert speeds[round(3.4 * STEPS_PER_SECOND)] == pytest.approx(3.0, abs=1e-3)
    assert abs(speeds[-1]) < 1e-3


@pytest.mark.parametrize('grade_deg', [10.0, -10.0])
def test_hill_neither_slows_the_car_nor_moves_it_when_stopped(grade_deg: float) -> None:
    seen = drive(
        lambda t: DriverInput(forward=3.0) if t < 8.0 else COAST, 16.0, grade_deg=grade_deg
    )
    assert seen[8 * STEPS_PER_SECOND].true.v_x == pytest.approx(3.0, abs=0.01)
    assert seen[-1].true.v_x == pytest.approx(0.0, abs=0.01)


def test_path_has_its_curvature_while_the_car_speeds_up() -> None:
    driver = VelocityDriver(LIMITS._replace(steering_rate=100.0))
    driver.receive(DriverInput(3.0, 0.3), 0.0)
    assert driver.command(0.0, 0.1).servo == pytest.approx(atan(0.3))


def test_on_the_spot_the_wheels_turn_to_their_limit_and_the_car_stays() -> None:
    driver = VelocityDriver()
    seen = drive(lambda _: DriverInput(turn=-1.0), 3.0, driver=driver)
    assert driver.servo == -LIMITS.steering
    assert seen[-1].true == seen[0].true


def test_brake_of_the_keyboard_stops_the_car() -> None:
    driver = VelocityDriver()
    driver.receive(FULL_BRAKE, 0.0)
    assert driver.command(0.0, 5.0) == (-LIMITS.deceleration, 0.0)


@given(FINITE, FINITE, FINITE, st.floats(-50.0, 50.0))
def test_every_finite_twist_gives_a_command_within_the_limits(
    forward: float, turn: float, brake: float, speed: float
) -> None:
    driver = VelocityDriver()
    for k in range(3):
        driver.receive(DriverInput(forward, turn, brake), k * driver.dt)
        motor, servo = driver.command(k * driver.dt, speed)
        assert abs(motor) <= max(LIMITS.acceleration, LIMITS.deceleration)
        assert abs(servo) <= LIMITS.steering


def values(**changed: float | str) -> dict[str, float | str | bool]:
    """Return the parameters of the relay."""
    return {each.name: each.default for each in PARAMETERS} | changed


def test_parameter_names_what_a_twist_means() -> None:
    driver = make_driver(values(input='velocity', l_f=1.0, l_r=1.5))
    assert isinstance(driver, VelocityDriver)
    assert driver.wheelbase == 2.5
    assert driver.receive(DriverInput(forward=3.0, turn=0.3), 0.0)
    driver.command(0.0, 0.0)
    assert driver.request == (3.0, 0.3, 0.0)
    assert not isinstance(make_driver(values()), VelocityDriver)
