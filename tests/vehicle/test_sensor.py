"""Measurement noise: identity without it, reproducible and independent with it."""

from __future__ import annotations

from itertools import pairwise
from math import cos, pi, sin
from statistics import fmean, stdev
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barc_sim.vehicle.bike_model import Motion
from barc_sim.vehicle.sensor import MeasurementError, NoiseLevels, Sensor

if TYPE_CHECKING:
    from collections.abc import Sequence

TRUE = Motion(x=30.0, y=-2.0, psi=0.7, v_x=8.0, v_y=0.3, psi_dot=-0.2)
NOISY = NoiseLevels(s=0.1, ey=0.2, epsi=0.03, v_x=0.4, v_y=0.05, psi_dot=0.06)

#: The second measurement's errors with standard deviations of 1 and seed 1.
PINNED = MeasurementError(
    s=-1.022103170010873,
    ey=-1.4368294451025299,
    epsi=0.19931197648375384,
    v_x=0.13337460465860485,
    v_y=0.5464683003382316,
    psi_dot=-0.9139709437353126,
)


def errors(sensor: Sensor, n: int) -> Sequence[MeasurementError]:
    return [sensor.measure(TRUE)[1] for _ in range(n)]


@pytest.mark.parametrize('sensor', [Sensor(), Sensor(NoiseLevels(), seed=7)])
def test_sensor_without_deviation_measures_the_truth(sensor: Sensor) -> None:
    for _ in range(3):
        # Compared as text: no error is to be -0.0, either.
        assert repr(sensor.measure(TRUE)) == repr((TRUE, MeasurementError()))


@settings(deadline=None, derandomize=True)
@given(psi=st.floats(-pi, pi), seed=st.integers())
def test_error_is_measured_minus_true_in_the_true_vehicles_frame(psi: float, seed: int) -> None:
    true = TRUE._replace(psi=psi)
    measured, error = Sensor(NOISY, seed).measure(true)
    d_x, d_y = measured.x - true.x, measured.y - true.y
    assert error == pytest.approx(
        MeasurementError(
            s=d_x * cos(psi) + d_y * sin(psi),
            ey=d_y * cos(psi) - d_x * sin(psi),
            epsi=measured.psi - psi,
            v_x=measured.v_x - true.v_x,
            v_y=measured.v_y - true.v_y,
            psi_dot=measured.psi_dot - true.psi_dot,
        ),
        abs=1e-12,
    )


def test_errors_are_the_same_on_every_python() -> None:
    unit = NoiseLevels(1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    assert errors(Sensor(unit, 1), 2)[-1] == pytest.approx(PINNED, rel=1e-12)


@pytest.mark.parametrize('off', MeasurementError._fields)
def test_turning_one_deviation_off_leaves_the_other_errors_as_they_were(off: str) -> None:
    all_on = errors(Sensor(NOISY, 3), 10)
    one_off = errors(Sensor(NOISY._replace(**{off: 0.0}), 3), 10)
    assert one_off == [error._replace(**{off: 0.0}) for error in all_on]


def test_errors_have_zero_mean_and_the_given_deviations_and_are_white() -> None:
    n = 20_000
    series = list(zip(*errors(Sensor(NOISY, 2), n), strict=True))
    for values, sigma in zip(series, NOISY, strict=True):
        assert abs(fmean(values)) < 5.0 * sigma / n**0.5
        assert stdev(values) == pytest.approx(sigma, rel=5.0 / (2 * n) ** 0.5)
        lagged = fmean(a * b for a, b in pairwise(values)) / sigma**2
        assert abs(lagged) < 5.0 / n**0.5
