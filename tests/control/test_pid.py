"""Each term of the PID alone, then its limits, its windup and its derivative's kick."""

from __future__ import annotations

from math import inf, isnan, nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barc_sim.control.pid import PID
from barc_sim.simulation.closed_loop import simulate
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


@properties
@given(sequence=samples)
def test_output_within_limits_is_the_sum_of_the_terms(
    sequence: list[tuple[float, float, float]],
) -> None:
    pid = PID(3.0, 4.0, 0.5)
    for reference, measurement, dt in sequence:
        output = pid.acc_calculate(reference, measurement, dt)
        terms = pid.proportional + pid.integral + pid.derivative
        assert output == pytest.approx(terms, abs=1e-9)
        assert not pid.saturated


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


def test_interval_is_the_constructors_unless_the_call_gives_one() -> None:
    by_default, explicit = PID(3.0, 4.0, 0.5, dt=0.1), PID(3.0, 4.0, 0.5)
    for measurement in (1.0, 3.0, 2.0):
        assert by_default.acc_calculate(8.0, measurement) == explicit.acc_calculate(
            8.0, measurement, 0.1
        )


@pytest.mark.parametrize('dt', [0.0, -0.02, nan])
def test_interval_that_is_not_positive_leaves_only_what_needs_no_time(dt: float) -> None:
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
        assert -2.0 <= pid.acc_calculate(reference, measurement, dt) <= 3.0


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


@pytest.mark.parametrize('limit', [8.0, inf])
def test_infinite_measurement_leaves_no_trace(limit: float) -> None:
    pid = PID(3.0, 4.0, 0.0, output_min=-limit, output_max=limit)
    outputs(pid, [7.0, 7.0], reference=8.0, dt=0.5)
    pid.acc_calculate(8.0, -inf, 0.5)
    assert pid.acc_calculate(8.0, 7.0, 0.5) == 3.0 + 2.0


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
