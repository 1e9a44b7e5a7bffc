"""Delay, limits and lag: against closed forms, and nothing at all where they are off."""

from __future__ import annotations

from math import exp, inf

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barc_sim.vehicle.actuators import Actuator, Actuators, ActuatorState
from barc_sim.vehicle.bike_model import Command

TS = 0.02
properties = settings(deadline=None, derandomize=True)
values = st.floats(-10.0, 10.0)
times = st.floats(1e-3, 10.0)
rates = st.floats(0.01, 100.0) | st.just(inf)
lags = st.floats(0.01, 10.0) | st.just(0.0)


def drive(actuator: Actuator, commands: list[float], ts: float = TS) -> list[tuple[float, float]]:
    """Return the mean over each step, and the value at its end."""
    channel = ActuatorState(actuator, ts)
    return [(channel.advance(command), channel.value) for command in commands]


# Off


@properties
@given(motor=values, servo=values)
def test_actuators_that_are_off_do_what_is_commanded(motor: float, servo: float) -> None:
    actuators = Actuators(Actuator(), Actuator(), TS)
    command = Command(motor, servo)
    # The very command: not even the sign of a zero may change.
    assert actuators.advance(command) is command
    assert actuators.now is command


@properties
@given(commands=st.lists(values, max_size=5), lag=st.floats(0.01, 1.0))
def test_one_actuator_leaves_the_other_alone(commands: list[float], lag: float) -> None:
    actuators = Actuators(Actuator(), Actuator(lag=lag), TS)
    for command in commands:
        assert actuators.advance(Command(command, 1.0)).motor == command == actuators.now.motor
        assert 0.0 < actuators.now.servo < 1.0


# Delay


@pytest.mark.parametrize('steps', [1, 2, 7])
def test_delay_of_whole_steps_shifts_the_commands(steps: int) -> None:
    commands = [float(k) for k in range(1, 20)]
    expected = [*[0.0] * steps, *commands][: len(commands)]
    assert drive(Actuator(delay=steps * TS), commands) == list(zip(expected, expected, strict=True))


@pytest.mark.parametrize('rate', [3.0, 7.0, 30.0, 60.0, 90.0])
@pytest.mark.parametrize('steps', [1, 3, 29])
def test_whole_steps_are_whole_whatever_rounding_makes_of_them(rate: float, steps: int) -> None:
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


@properties
@given(delay=st.floats(0.0, 0.3), command=values)
def test_mean_over_a_delay_is_the_integral_of_what_acts(delay: float, command: float) -> None:
    means = [mean for mean, _ in drive(Actuator(delay=delay), [command] * 20)]
    assert sum(means) * TS == pytest.approx(command * (20 * TS - delay), abs=1e-6)


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
    middle, mean_1 = actuator.respond(value, target, first)
    end, mean_2 = actuator.respond(middle, target, second)
    whole, mean = actuator.respond(value, target, first + second)
    assert end == pytest.approx(whole, abs=1e-9)
    assert mean_1 * first + mean_2 * second == pytest.approx(mean * (first + second), abs=1e-8)


@properties
@given(value=values, target=values, lag=lags, rate=rates, t=times)
def test_response_stays_between_where_it_is_and_where_it_goes(
    value: float, target: float, lag: float, rate: float, t: float
) -> None:
    after, mean = Actuator(lag=lag, rate=rate).respond(value, target, t)
    low, high = sorted((value, target))
    assert low - 1e-9 <= after <= high + 1e-9
    assert low - 1e-9 <= mean <= high + 1e-9
    assert abs(after - value) <= rate * t + 1e-9


def test_lag_and_its_mean_are_right_where_it_is_long_or_short() -> None:
    after, mean = Actuator(lag=100.0).respond(0.0, 1.0, TS)
    assert (after, mean) == (pytest.approx(TS / 100.0, rel=1e-3), pytest.approx(0.0, abs=1e-3))
    assert Actuator(lag=1e-12).respond(0.0, 1.0, TS) == (1.0, pytest.approx(1.0))


# Limits


def test_rate_limit_is_a_ramp_to_the_command_and_ends_on_it() -> None:
    ends = [value for _, value in drive(Actuator(rate=10.0), [1.0] * 7)]
    assert ends == [*(pytest.approx(0.2 * k) for k in range(1, 5)), *[1.0] * 3]
    assert drive(Actuator(rate=10.0), [1.0])[0][0] == pytest.approx(0.1)


def test_lag_takes_over_from_the_ramp_where_it_is_slower() -> None:
    lag, rate = 0.1, 10.0
    # From 3 to 1 short of the target at 10/s, in 0.2 s; then the exponential.
    after, _ = Actuator(lag=lag, rate=rate).respond(0.0, 3.0, 0.5)
    assert after == pytest.approx(3.0 - rate * lag * exp(-0.3 / lag), rel=1e-12)


def test_command_beyond_the_limit_is_cut_either_way() -> None:
    limited = drive(Actuator(limit=0.5), [0.3, 9.0, -9.0])
    assert limited == [(0.3, 0.3), (0.5, 0.5), (-0.5, -0.5)]


# Brakes


def test_brakes_act_at_once_and_the_motor_begins_anew() -> None:
    slow = Actuator(delay=0.1, lag=0.2, rate=1.0, limit=2.0)
    actuators = Actuators(slow, slow, TS)
    for _ in range(20):
        actuators.advance(Command(2.0, 0.3))
    steered = actuators.now.servo
    assert actuators.brake(Command(-8.0, 0.3)).motor == -8.0
    assert actuators.now.motor == -8.0
    assert actuators.now.servo > steered
    assert [actuators.advance(Command(2.0, 0.3)).motor for _ in range(5)] == [0.0] * 5
    assert actuators.advance(Command(2.0, 0.3)).motor > 0.0


# Replaced while it works


@pytest.mark.parametrize(('before', 'after'), [(0, 3), (1, 4), (4, 1), (5, 0)])
def test_replaced_delay_counts_from_the_next_command(before: int, after: int) -> None:
    actuators = Actuators(Actuator(delay=before * TS), Actuator(), TS)
    for k in range(1, 11):
        actuators.advance(Command(float(k)))
    actuators.replace(Actuator(delay=after * TS), Actuator())
    acted = [actuators.advance(Command(float(k))).motor for k in range(11, 21)]
    # Where the delay grew, the command that acts now acts meanwhile.
    assert acted == [max(k - after, 10.0 - before) for k in range(11, 21)]


def test_replaced_limit_cuts_what_is_on_its_way() -> None:
    actuators = Actuators(Actuator(delay=2 * TS), Actuator(), TS)
    for _ in range(5):
        actuators.advance(Command(6.0))
    actuators.replace(Actuator(delay=2 * TS, limit=4.0), Actuator())
    assert actuators.advance(Command(6.0)).motor == 4.0
