"""PID, LQR, and any object with `acc_calculate`."""

from __future__ import annotations

import math
from math import isnan, nan
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barc_sim.control.speed import LQR, PID, Gain, as_controller, feedback_gain
from barc_sim.errors import UserError
from barc_sim.simulation.closed_loop import closed_loop, simulate
from barc_sim.simulation.metrics import summary

properties = settings(deadline=None, derandomize=True)
samples = st.lists(
    st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(0.0, 0.5)), max_size=40
)


def outputs(pid: PID, measurements: list[float], *, reference: float, dt: float) -> list[float]:
    return [pid.acc_calculate(reference, measurement, dt) for measurement in measurements]


# Each term alone


def test_proportional_term_is_kp_times_reference_minus_measurement() -> None:
    pid = PID(3.0, 0.0, 0.0)
    assert outputs(pid, [0.0, 7.0, 9.0], reference=8.0, dt=0.02) == [24.0, 3.0, -3.0]
    assert (pid.proportional, pid.integral, pid.derivative) == (-3.0, 0.0, 0.0)


def test_integral_term_is_ki_times_the_sum_of_errors_since_the_first_sample() -> None:
    pid = PID(0.0, 4.0, 0.0)
    assert outputs(pid, [7.0, 7.0, 6.0, 9.0], reference=8.0, dt=0.5) == [0.0, 2.0, 6.0, 4.0]
    assert (pid.proportional, pid.integral, pid.derivative) == (0.0, 4.0, 0.0)


def test_derivative_term_opposes_the_measurements_rate() -> None:
    pid = PID(0.0, 0.0, 2.0)
    assert outputs(pid, [5.0, 5.5, 5.5, 5.25], reference=8.0, dt=0.5) == [0.0, -2.0, 0.0, 1.0]
    assert (pid.proportional, pid.integral, pid.derivative) == (0.0, 0.0, 1.0)


# The first sample and the kick


def test_first_sample_has_no_derivative_and_adds_nothing_to_the_integral() -> None:
    pid = PID(1.0, 100.0, 100.0)
    assert pid.acc_calculate(8.0, 3.0, 0.02) == 5.0
    assert (pid.integral, pid.derivative) == (0.0, 0.0)


def test_changed_reference_does_not_kick() -> None:
    pid = PID(0.0, 0.0, 100.0)
    pid.acc_calculate(8.0, 3.0, 0.02)
    assert pid.acc_calculate(-8.0, 3.0, 0.02) == 0.0


# The interval


@pytest.mark.parametrize('dt', [0.0, -0.02, nan])
def test_an_interval_that_is_not_positive_adds_to_no_integral_and_has_no_derivative(
    dt: float,
) -> None:
    pid = PID(3.0, 4.0, 5.0)
    outputs(pid, [7.0, 7.0], reference=8.0, dt=0.5)
    assert pid.acc_calculate(8.0, 6.0, dt) == 3.0 * 2.0 + 4.0 * 0.5
    assert (pid.integral, pid.derivative) == (2.0, 0.0)
    # The next derivative is taken from that sample on.
    pid.acc_calculate(8.0, 6.5, 0.5)
    assert pid.derivative == -5.0


# Limits and windup


def test_output_is_limited_and_marked_saturated() -> None:
    pid = PID(1.0, 0.0, 0.0, output_min=-2.0, output_max=3.0)
    assert pid.acc_calculate(8.0, 0.0) == 3.0

    assert pid.saturated
    assert pid.proportional == 8.0
    assert pid.acc_calculate(0.0, 8.0) == -2.0

    assert pid.saturated
    for at_or_within in (-2.0, 0.5, 3.0):
        assert pid.acc_calculate(at_or_within, 0.0) == at_or_within
        assert not pid.saturated


@properties
@given(sequence=samples)
def test_output_never_leaves_the_limits(sequence: list[tuple[float, float, float]]) -> None:
    pid = PID(3.0, 4.0, 0.5, output_min=-2.0, output_max=3.0)
    for reference, measurement, dt in sequence:
        output = pid.acc_calculate(reference, measurement, dt)
        assert -2.0 <= output <= 3.0
        terms = pid.proportional + pid.integral + pid.derivative
        assert pid.saturated or output == pytest.approx(terms, abs=1e-9)


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_output_leaves_the_limit_as_soon_as_the_error_changes_sign(sign: float) -> None:
    pid = PID(1.0, 10.0, 0.0, output_min=-8.0, output_max=8.0)
    outputs(pid, [0.0] * 5000, reference=sign * 4.0, dt=0.02)
    assert pid.saturated
    assert abs(pid.integral) <= 8.0
    output = pid.acc_calculate(sign * 4.0, sign * 4.1, 0.02)
    assert not pid.saturated
    assert abs(output) < 8.0


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_integral_stands_still_while_the_error_holds_the_output_at_the_limit(sign: float) -> None:
    pid = PID(10.0, 1.0, 0.0, output_min=-8.0, output_max=8.0)
    assert outputs(pid, [0.0] * 9, reference=sign * 4.0, dt=0.5) == [sign * 8.0] * 9
    assert pid.integral == 0.0


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_integral_takes_no_step_that_would_cross_the_limit(sign: float) -> None:
    pid = PID(0.0, 1.0, 0.0, output_min=-1.0, output_max=1.0)
    assert outputs(pid, [0.0] * 3, reference=sign * 1.5, dt=0.5) == [0.0, sign * 0.75, sign * 1.0]
    assert pid.integral == sign * 0.75


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_integral_moves_away_from_the_limit_while_the_output_is_cut(sign: float) -> None:
    pid = PID(0.0, 1.0, 0.0, output_min=-8.0, output_max=8.0)
    outputs(pid, [0.0] * 4, reference=sign * 4.0, dt=0.5)
    assert pid.integral == sign * 6.0
    pid.output_min, pid.output_max = -1.0, 1.0
    assert pid.acc_calculate(sign * -4.0, 0.0, 0.5) == sign * 1.0
    assert pid.saturated
    assert pid.integral == sign * 4.0


@pytest.mark.parametrize(('low', 'high'), [(1.0, -1.0), (1.0, 1.0), (nan, 1.0)])
def test_limits_in_the_wrong_order_are_refused(low: float, high: float) -> None:
    with pytest.raises(ValueError, match=f'output_min={low} must be below output_max={high}'):
        PID(1.0, 1.0, 1.0, output_min=low, output_max=high)


# Changes while running


def test_changed_ki_does_not_rescale_the_past() -> None:
    pid = PID(0.0, 4.0, 0.0)
    outputs(pid, [7.0, 7.0, 7.0], reference=8.0, dt=0.5)
    pid.ki = 0.0
    assert pid.acc_calculate(8.0, 7.0, 0.5) == 4.0
    pid.ki = 2.0
    assert pid.acc_calculate(8.0, 7.0, 0.5) == 5.0


# What is not finite


@pytest.mark.parametrize(('reference', 'measurement'), [(8.0, nan), (nan, 7.0)])
@pytest.mark.parametrize('kd', [0.0, 0.5])
def test_nan_gives_nan_once_and_leaves_no_trace(
    reference: float, measurement: float, kd: float
) -> None:
    pid = PID(3.0, 4.0, kd, output_min=-8.0, output_max=8.0)
    outputs(pid, [7.0, 7.0], reference=8.0, dt=0.5)
    assert isnan(pid.acc_calculate(reference, measurement, 0.5))
    assert not pid.saturated
    assert pid.integral == 2.0
    assert pid.acc_calculate(8.0, 7.0, 0.5) == 3.0 + 2.0
    assert pid.acc_calculate(8.0, 7.0, 0.5) == 3.0 + 4.0


def test_presets_show_what_each_term_does() -> None:
    runs = {name: summary(simulate(**gains)) for name, gains in PID.presets.items()}
    errors = {name: run.rms_error_after_run_up for name, run in runs.items()}

    assert runs['P'].max_error_after_run_up == pytest.approx(4.9 / 4.0, abs=0.01)  # on the hill
    assert runs['P'].overshoot == 0.0
    assert 0.4 < errors['PI'] / errors['P'] < 0.5
    assert errors['PI'] < errors['PID'] < errors['Too much I']
    assert runs['Too much I'].overshoot == max(run.overshoot for run in runs.values())
    assert PID.presets['Tuned'] == {name: gain.default for name, gain in PID.gains.items()}
    assert errors['Tuned'] == min(errors.values()) == pytest.approx(0.021, abs=5e-4)


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


def test_reset_clears_the_memory_of_the_lqr() -> None:
    controller = LQR()
    first = [controller.acc_calculate(8.0, v, DT) for v in (7.0, 7.3)]
    controller.reset()
    assert [controller.acc_calculate(8.0, v, DT) for v in (7.0, 7.3)] == first


def test_lqr_holds_the_speed_on_the_labs_road() -> None:
    log = closed_loop(controller=LQR(output_min=-8.0, output_max=8.0))
    result = summary(log)
    assert result.rms_error_after_run_up < 0.02
    assert result.max_error_after_run_up < 0.12

    terms = log.terms
    assert [*terms] == ['feedback', 'compensation']
    np.testing.assert_array_equal(
        np.clip(terms['feedback'] + terms['compensation'], -8.0, 8.0), log.motor
    )


class Lab:
    """The lab's controller, as its template has it."""

    def __init__(self, kp: float = 10.0, ki: float = 0.5) -> None:
        self.kp = kp
        self.ki = ki
        self.int_error = 0.0

    def acc_calculate(self, speed_reference: float, speed_current: float) -> float:
        """Return the acceleration [m/s²]."""
        error = speed_reference - speed_current
        self.int_error += error
        return self.kp * error + self.ki * self.int_error


class WithDt(Lab):
    """One that takes dt by its name."""

    def acc_calculate(self, reference: float, current: float, dt: float) -> float:  # type: ignore[override]
        """Return the acceleration [m/s²], and keep the interval."""
        self.seen = dt
        return super().acc_calculate(reference, current)


class WithStep(Lab):
    """One that takes dt by another name."""

    def acc_calculate(self, reference: float, current: float, step: float) -> float:  # type: ignore[override]
        """Return the acceleration [m/s²], and keep the interval."""
        self.integral = step
        return super().acc_calculate(reference, current)


@pytest.mark.parametrize('kind', [Lab, WithDt, WithStep])
def test_two_arguments_or_three_give_the_same_run(kind: type[Lab]) -> None:
    log = closed_loop(controller=as_controller(kind()), distance=30.0)
    assert log.distance[-1] >= 30.0
    assert (log.motor == closed_loop(controller=as_controller(Lab()), distance=30.0).motor).all()


def test_the_users_object_is_not_changed() -> None:
    original = Lab()
    adapted = as_controller(original)
    first = [adapted.acc_calculate(8.0, 7.0, 0.02) for _ in range(3)]
    adapted.reset()
    assert [adapted.acc_calculate(8.0, 7.0, 0.02) for _ in range(3)] == first
    assert original.int_error == 0.0


def test_gains_are_those_that_the_object_has_and_can_be_set() -> None:
    adapted: Any = as_controller(Lab())
    assert [*adapted.gains] == ['kp', 'ki']
    assert adapted.kp == 10.0
    adapted.acc_calculate(8.0, 7.0, 0.02)
    adapted.kp = 20.0
    assert adapted.acc_calculate(8.0, 7.0, 0.02) == 21.0


def test_output_is_limited_and_terms_are_the_objects() -> None:
    adapted: Any = as_controller(WithStep())
    adapted.output_min, adapted.output_max = -2.0, 2.0
    assert adapted.acc_calculate(8.0, 0.0, 0.02) == 2.0
    assert adapted.saturated
    assert adapted.integral == 0.02
    assert adapted.derivative != adapted.derivative


def test_a_users_object_can_declare_gains_and_terms() -> None:
    class Own:
        gains = {'gain': Gain(2.0, '1/s', 'the gain', 10.0)}  # noqa: RUF012
        terms = {'pull': 'toward the reference'}  # noqa: RUF012
        gain = 3.0

        def acc_calculate(self, reference: float, current: float) -> float:
            self.pull = self.gain * (reference - current)
            return self.pull

    log = closed_loop(controller=as_controller(Own()), distance=10.0)
    assert [*log.terms] == ['pull']
    assert (log.terms['pull'] == log.motor).all()


@pytest.mark.parametrize(
    ('wrong', 'message'),
    [
        (PID, r'controller=PID is a class; expected an object, such as PID\('),
        (Lab, r'controller=Lab is a class; expected an object, such as Lab\('),
        (3.0, r'controller=3\.0 has no method acc_calculate\(speed_reference, speed_current\)'),
        (
            type('One', (), {'acc_calculate': lambda self, error: error})(),  # noqa: ARG005
            r'acc_calculate takes \(error\): expected \(speed_reference, speed_current\)',
        ),
    ],
)
def test_an_unusable_controller_is_refused(wrong: object, message: str) -> None:
    with pytest.raises(UserError, match=message):
        as_controller(wrong)
