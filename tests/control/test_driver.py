"""Driving by hand: what a request does to acceleration and wheel, and what it cannot do."""

from __future__ import annotations

from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from barc_sim.control.driver import COAST, FULL_BRAKE, Driver, DriverInput, DriverLimits

LIMITS = DriverLimits()
SHARE = st.floats(-1e300, 1e300)


def drive(driver: Driver, request: DriverInput, seconds: float, *, speed: float = 0.0) -> float:
    """Repeat `request` in every period for `seconds`; return the speed then, on the flat."""
    for k in range(round(seconds / driver.dt)):
        driver.receive(request, k * driver.dt)
        speed += driver.dt * driver.command(k * driver.dt, speed).motor
    return speed


def test_limits_are_the_documented_ones() -> None:
    assert LIMITS == (4.0, 8.0, 20.0, 0.5, 1.0, True)
    assert (Driver().dt, Driver().stale_after) == (0.05, 0.5)


def test_full_throttle_gives_the_maximum_acceleration_and_half_throttle_half_of_it() -> None:
    driver = Driver()
    driver.receive(DriverInput(forward=1.0), 0.0)
    assert driver.command(0.0, 0.0) == (LIMITS.acceleration, 0.0)
    driver.receive(DriverInput(forward=0.5), 0.05)
    assert driver.command(0.05, 0.0) == (LIMITS.acceleration / 2, 0.0)


@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_against_the_motion_is_deceleration_down_to_a_standstill(direction: float) -> None:
    driver = Driver()
    driver.receive(DriverInput(forward=-direction), 0.0)
    assert driver.command(0.0, 8.0 * direction).motor == -direction * LIMITS.deceleration
    speed = drive(driver, DriverInput(forward=-direction), 3.0, speed=8.0 * direction)
    assert speed * direction == pytest.approx(0.0, abs=1e-6)
    assert speed * direction >= 0.0


def test_the_car_reverses_only_after_the_key_is_released_and_pressed_again() -> None:
    driver = Driver()
    back = DriverInput(forward=-1.0)
    assert drive(driver, back, 5.0, speed=8.0) == pytest.approx(0.0, abs=1e-6)
    drive(driver, COAST, 0.05)
    assert drive(driver, back, 1.0) == pytest.approx(-LIMITS.acceleration)


def test_forward_after_braking_to_a_standstill_works_without_releasing_the_key() -> None:
    driver = Driver()
    drive(driver, DriverInput(forward=-1.0), 3.0, speed=8.0)
    assert drive(driver, DriverInput(forward=1.0), 1.0) == pytest.approx(LIMITS.acceleration)


@pytest.mark.parametrize('speed', [10.0, -10.0])
def test_the_brake_stops_the_car_either_way_and_stays_on(speed: float) -> None:
    driver = Driver()
    driver.receive(FULL_BRAKE, 0.0)
    speeds = [speed]
    for k in range(400):  # 20 s: long after the request has gone stale
        speeds.append(speeds[-1] + driver.dt * driver.command(k * driver.dt, speeds[-1]).motor)
    assert abs(speeds[25]) == pytest.approx(0.0, abs=0.4)
    assert speeds[-1] == pytest.approx(0.0, abs=1e-9)
    assert all(v * speed >= 0.0 for v in speeds)


def test_a_command_that_holds_for_longer_than_it_should_does_not_reverse_the_car() -> None:
    driver = Driver()
    speed = 5.0
    driver.receive(FULL_BRAKE, 0.0)
    for k in range(100):
        speed += 1.6 * driver.dt * driver.command(k * driver.dt, speed).motor
        assert speed >= 0.0


def test_the_wheel_turns_at_its_rate_up_to_its_limit() -> None:
    driver = Driver()
    driver.receive(DriverInput(turn=1.0), 0.0)
    angles = [driver.command(0.0, 0.0).servo for _ in range(20)]
    assert angles[0] == pytest.approx(LIMITS.steering_rate * driver.dt)
    assert angles[-1] == LIMITS.steering


def test_the_wheel_let_go_returns_to_straight_and_not_past_it() -> None:
    driver = Driver()
    driver.receive(DriverInput(turn=0.7), 0.0)
    for _ in range(7):
        driver.command(0.0, 0.0)
    driver.receive(COAST, 0.0)
    angles = [driver.command(0.0, 0.0).servo for _ in range(20)]

    assert angles[0] == pytest.approx(0.7 * 7 * driver.dt - driver.dt)
    assert angles[-1] == 0.0
    assert min(angles) == 0.0


def test_a_wheel_that_stays_is_only_put_straight_by_the_brake() -> None:
    driver = Driver(DriverLimits(self_centring=False))
    driver.receive(DriverInput(turn=1.0), 0.0)
    turned = driver.command(0.0, 0.0).servo
    driver.receive(COAST, 0.0)
    assert driver.command(0.0, 0.0).servo == turned
    driver.receive(FULL_BRAKE, 0.0)
    assert driver.command(0.0, 0.0).servo == 0.0


def test_a_stale_request_is_coasting_with_the_wheel_going_straight() -> None:
    driver = Driver(stale_after=0.5)
    driver.receive(DriverInput(forward=1.0, turn=1.0), 10.0)
    assert driver.command(10.5, 0.0) == (LIMITS.acceleration, 0.05)
    assert driver.command(10.51, 0.0) == (0.0, 0.0)


def test_reset_clears_request_and_wheel() -> None:
    driver = Driver()
    driver.receive(DriverInput(forward=1.0, turn=1.0), 0.0)
    driver.command(0.0, 0.0)
    driver.reset()
    assert driver.command(0.0, 0.0) == (0.0, 0.0)


@pytest.mark.parametrize('value', [nan, inf, -inf])
def test_a_share_that_is_not_finite_is_refused(value: float) -> None:
    driver = Driver()
    assert driver.receive(DriverInput(1.0, -1.0, 0.0), 0.0)
    for request in (DriverInput(forward=value), DriverInput(turn=value), DriverInput(brake=value)):
        assert not driver.receive(request, 0.0)
    assert driver.command(0.0, 0.0).motor == LIMITS.acceleration


@given(st.lists(st.tuples(SHARE, SHARE, SHARE, st.floats(0.0, 1.0), st.floats(-50.0, 50.0))))
def test_any_request_stays_within_the_limits(
    requests: list[tuple[float, float, float, float, float]],
) -> None:
    driver = Driver()
    t, angle = 0.0, 0.0
    for forward, turn, brake, wait, speed in requests:
        driver.receive(DriverInput(forward, turn, brake), t)
        t += wait
        command = driver.command(t, speed)

        assert abs(command.motor) <= max(LIMITS.acceleration, LIMITS.deceleration)
        assert abs(command.servo) <= LIMITS.steering
        assert abs(command.servo - angle) <= LIMITS.steering_rate * driver.dt + 1e-12
        angle = command.servo
