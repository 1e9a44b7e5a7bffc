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
from barc_sim.vehicle.sensor import MeasurementError, NoiseLevels, Sensor, with_error

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


# Delay


def at(k: int) -> Motion:
    return Motion(x=0.1 * k * k, y=-0.2 * k, psi=0.3 * k, v_x=10.0 * k, v_y=k, psi_dot=-k)


@pytest.mark.parametrize(('delay', 'steps'), [(0.04, 2.0), (0.05, 2.5), (0.001, 0.05), (0.02, 1.0)])
def test_a_late_measurement_is_that_of_before(delay: float, steps: float) -> None:
    sensor = Sensor(delay=delay)
    for k in range(40):
        seen, error = sensor.measure(at(k))
        if k > steps:
            share = -steps % 1.0
            new, old = at(k - int(steps)), at(k - int(steps + 0.99))
            expected = [share * a + (1.0 - share) * b for a, b in zip(new, old, strict=True)]
            assert seen == pytest.approx(expected if steps % 1.0 else new)
        elif k == 0:
            assert seen == at(0)
        true, psi = at(k), at(k).psi
        assert seen == pytest.approx(with_error(true, error, cos(psi), sin(psi)), abs=1e-9)


def test_noise_and_delay_add_up() -> None:
    noise = NoiseLevels(v_x=0.5)
    late, punctual = Sensor(noise, 3, delay=0.02), Sensor(noise, 3)
    seen = [late.measure(at(k))[0].v_x for k in range(20)]
    errors = [punctual.measure(at(k))[1].v_x for k in range(20)]
    assert seen == [10.0 * max(k - 1, 0) + error for k, error in enumerate(errors)]


def test_a_delay_can_change_and_a_car_can_be_put_elsewhere() -> None:
    sensor = Sensor()
    for k in range(10):
        sensor.measure(at(k))
    sensor.delay = 0.04
    assert [sensor.measure(at(k))[0] for k in (10, 11, 12, 13)] == [at(10), at(10), at(10), at(11)]
    sensor.delay = 0.02
    assert sensor.measure(at(14))[0] == at(13)
    sensor.forget()
    assert sensor.measure(at(50))[0] == at(50)
