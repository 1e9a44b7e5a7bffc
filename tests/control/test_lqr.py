"""The LQR: its gain against the Riccati equation, and its observer against a known disturbance."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barc_sim.control.lqr import LQR, feedback_gain
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.simulation.metrics import summary

DT = 0.02
WEIGHTS = st.floats(1e-3, 1e6)


def closed_form(q: float, r: float, dt: float) -> float:
    """Return the gain by the closed-loop pole: z within the unit circle, z + 1/z = 2 + q dt² / r.

    With 1/z = 1 + s, the gain is K = (1 - z) / dt = s / (1 + s) / dt.
    """
    half = q * dt * dt / (2.0 * r)
    s = half + math.sqrt(half * (half + 2.0))
    return s / (1.0 + s) / dt


@given(WEIGHTS, WEIGHTS)
def test_gain_is_the_closed_form_of_the_scalar_riccati_equation(q: float, r: float) -> None:
    assert feedback_gain(q, r, DT) == pytest.approx(closed_form(q, r, DT), rel=1e-12)


def test_a_constant_disturbance_leaves_no_error() -> None:
    controller, v = LQR(), 8.0
    for _ in range(500):
        v += DT * (controller.acc_calculate(8.0, v, DT) - 4.9)
    assert v == pytest.approx(8.0, abs=1e-9)
    assert controller.compensation == pytest.approx(4.9)


def test_the_observer_does_not_wind_up_at_the_limit() -> None:
    controller, v = LQR(output_min=-1.0, output_max=1.0), 0.0
    for _ in range(300):
        v += DT * controller.acc_calculate(8.0, v, DT)
        assert controller.compensation == pytest.approx(0.0, abs=1e-9)
        assert controller.saturated


@pytest.mark.parametrize('sample', [math.nan, math.inf])
def test_a_sample_that_is_not_finite_has_no_effect_on_later_ones(sample: float) -> None:
    clean, spoilt = LQR(), LQR()
    for v in (7.0, sample):
        spoilt.acc_calculate(8.0, v, DT)
    for v in (7.0, 7.2, 7.3):
        assert spoilt.acc_calculate(8.0, v, DT) == clean.acc_calculate(8.0, v, DT)


def test_reset_begins_anew() -> None:
    controller = LQR()
    first = [controller.acc_calculate(8.0, v, DT) for v in (7.0, 7.3)]
    controller.reset()
    assert [controller.acc_calculate(8.0, v, DT) for v in (7.0, 7.3)] == first


def test_it_holds_the_speed_on_the_labs_road() -> None:
    log = closed_loop(controller=LQR(output_min=-8.0, output_max=8.0))
    result = summary(log)
    assert result.rms_error_after_run_up < 0.02
    assert result.max_error_after_run_up < 0.12
    terms = log.terms
    assert [*terms] == ['feedback', 'compensation']
    np.testing.assert_array_equal(
        np.clip(terms['feedback'] + terms['compensation'], -8.0, 8.0), log.motor
    )
