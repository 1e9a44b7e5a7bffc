"""Test signals: what their definitions promise."""

from __future__ import annotations

import numpy as np
import pytest

from barc_sim import simulate
from barc_sim.control.excitation import PRBS, CoastDown, SineSteer, Steps


def test_the_binary_sequence_has_its_maximum_length() -> None:
    """Its autocorrelation is 1 at 0 and -1/1023 at every other shift (Ljung, 13.3)."""
    prbs = PRBS(hold=0.0, amplitude=1.0, interval=0.02)
    bits = np.array([prbs.acc_calculate(8.0, 0.0, 0.02) for _ in range(2046)])
    assert set(bits) == {-1.0, 1.0}
    assert (bits[:1023] == bits[1023:]).all()

    correlation = [bits[:1023] @ bits[k : k + 1023] for k in range(1023)]
    assert correlation[0] == 1023.0
    assert set(correlation[1:]) == {-1.0}

    prbs.reset()
    assert prbs.acc_calculate(8.0, 0.0) == bits[0]


def test_steps_follow_one_another() -> None:
    """Each lasts for the interval."""
    log = simulate(controller=Steps(hold=0.0, interval=0.1), road='flat', max_duration=0.4)
    assert [*log.motor[2:20:5]] == [0.0, 2.0, 0.0, -2.0]


def test_a_coast_down_rolls_between_the_two_speeds() -> None:
    """It goes up, and rolls with no command."""
    car = CoastDown(share=0.5)
    assert car.acc_calculate(8.0, 0.0) == 2.0
    assert car.acc_calculate(8.0, 8.1) == 0.0
    assert car.acc_calculate(8.0, 4.1) == 0.0
    assert car.acc_calculate(8.0, 3.9) == 2.0


def test_limits_and_terms_are_those_of_any_controller() -> None:
    """The output is their sum within the limits."""
    signal = Steps(interval=1.0, output_max=1.0)
    assert signal.acc_calculate(8.0, 0.0) == 1.0
    assert signal.saturated
    assert (signal.holding, signal.test_signal) == (4.0, 0.0)


def test_the_sine_is_upon_the_steering_of_the_lane() -> None:
    """On a straight, without errors, it is all."""
    law = SineSteer(amplitude=0.1, frequency=0.5)
    steers = [law.steer_calculate(0.0, 0.0, 5.0, lambda _: 0.0) for _ in range(100)]
    assert steers[25] == pytest.approx(0.1)
    assert steers[75] == pytest.approx(-0.1)
