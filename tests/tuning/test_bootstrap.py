"""Intervals by the bootstrap: those of theory for white noise, and wider for other noise."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from barc_sim import Vehicle, identify, simulate
from barc_sim.control.excitation import PRBS
from barc_sim.errors import UserError
from barc_sim.tuning.bootstrap import half_interval, resampled
from barc_sim.tuning.prediction import stretches

if TYPE_CHECKING:
    from barc_sim.simulation.log import Log

pytest.importorskip('scipy')
pytestmark = pytest.mark.timeout(120)

NAMES = ('drag_per_mass', 'friction_per_mass', 'motor_delay')
RESAMPLES = 60


def drive(noise: float) -> Log:
    """Return the log of a car with resistance and delay, and white noise of the speed [m/s]."""
    return simulate(
        controller=PRBS(amplitude=3.0),
        vehicle=Vehicle(friction=300.0, air_drag_coeff=0.8),
        road='flat',
        noise=noise,
        delay=0.11,
        distance=60.0,
        seed=3,
    )


@pytest.fixture(scope='module')
def white() -> Log:
    """Return a drive with white noise."""
    return drive(0.03)


@pytest.fixture(scope='module')
def correlated() -> Log:
    """Return a drive with noise of the same size, each of whose values is near the one before."""
    log = drive(0.0)
    random = np.random.default_rng(7)
    noise = np.zeros(len(log))
    for k, shock in enumerate(random.normal(0.0, 0.03 * 0.6, len(log) - 1)):
        noise[k + 1] = 0.8 * noise[k] + shock
    return replace(log, v_x=log.v_x + noise)


def test_for_white_noise_the_intervals_are_those_of_theory(white: Log) -> None:
    by_theory = identify(white)
    by_resamples = identify(white, bootstrap=RESAMPLES)
    for name in NAMES:
        assert by_resamples[name].value == by_theory[name].value
        ratio = by_resamples[name].interval / by_theory[name].interval
        assert 0.6 < ratio < 1.6, name


def test_for_correlated_noise_they_are_wider(correlated: Log) -> None:
    by_theory = identify(correlated)
    by_resamples = identify(correlated, bootstrap=RESAMPLES)
    for name in NAMES:
        assert by_resamples[name].interval > 1.3 * by_theory[name].interval, name
    assert any('the intervals are too narrow' in remark for remark in by_theory.remarks)
    assert any('are often still too narrow' in remark for remark in by_resamples.remarks)


def test_they_are_the_same_whoever_fits(white: Log) -> None:
    alone = identify(white, bootstrap=RESAMPLES, seed=5)
    with ProcessPoolExecutor(2) as executor:
        shared = identify(white, bootstrap=RESAMPLES, seed=5, executor=executor)
    assert shared.estimates == alone.estimates
    assert identify(white, bootstrap=RESAMPLES, seed=6).estimates != alone.estimates


def test_without_noise_there_is_no_interval() -> None:
    estimates = identify(drive(0.0), bootstrap=40).estimates
    assert all(estimates[name].interval < 1e-3 * estimates[name].value for name in NAMES)


@pytest.mark.parametrize('bootstrap', [1, 39, -5])
def test_too_few_resamples_are_refused(bootstrap: int, white: Log) -> None:
    with pytest.raises(UserError, match=f'bootstrap={bootstrap} must be at least 40'):
        identify(white, bootstrap=bootstrap)


def test_a_resample_has_other_residuals_of_the_same_size_in_blocks(white: Log) -> None:
    parts = [*stretches(white), *stretches(white)]
    counts = [len(part.counted) for part in parts]
    # So that each residual names its place.
    errors = np.arange(float(sum(counts)))[np.newaxis]
    first, second = resampled(parts, errors, 1.0, np.random.default_rng(1))

    begin = 0
    for part, other, count in zip(parts, (first, second), counts, strict=True):
        rows = part.counted
        of_part = errors[0, begin : begin + count]
        prediction = part.measured[0, rows] + of_part
        places = of_part.mean() - (other.measured[0, rows] - prediction)
        places = np.round(places).astype(int)
        assert places.min() >= begin
        assert places.max() < begin + count
        assert len({*places}) > count // 2
        length = round(sum(counts) ** (1.0 / 3.0))
        assert np.mean(np.diff(places) == 1) > 1.0 - 1.5 / length
        assert np.array_equal(other.t, part.t)
        begin += count


def test_the_half_interval_reaches_the_farther_percentile() -> None:
    assert half_interval(10.0, np.linspace(0.0, 100.0, 1001)) == pytest.approx(87.5)
    assert half_interval(90.0, np.linspace(0.0, 100.0, 1001)) == pytest.approx(87.5)
