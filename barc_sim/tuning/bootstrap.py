"""The bootstrap of the residuals: intervals of estimates without a linearisation.

The output-error method leaves residuals, the measurement minus the prediction. A resample is the
prediction plus residuals drawn again; the parameters are fitted to each resample, and the
percentiles of the fits are the interval (Efron and Tibshirani, "An Introduction to the Bootstrap",
chapters 9 and 13). The commands stay as they were, because the prediction depends on their order.

Residuals that are not white, as of a car that does more than the model, are drawn in blocks, which
keep their correlation: the circular block bootstrap (Politis and Romano, in "Exploring the Limits
of Bootstrap", 1992), with blocks of the order n^(1/3) (Hall, Horowitz and Jing, Biometrika 82,
1995).
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from barc_sim.simulation.log import Floats
    from barc_sim.tuning.prediction import Stretch

_PERCENTILES = (2.5, 97.5)


def resampled(
    stretches: Sequence[Stretch], errors: Floats, inflation: float, random: np.random.Generator
) -> tuple[Stretch, ...]:
    """Return the stretches with another measurement: the prediction plus residuals drawn again.

    Parameters
    ----------
    stretches
        The drives.
    errors
        Predicted minus measured, where there is a measurement, of one stretch after the other: a
        row for each signal.
    inflation
        Factor of the residuals, which a fit makes smaller than the noise.
    random
        Draws them.
    """
    signals = len(errors)
    length = max(round(errors.shape[1] ** (1.0 / 3.0)), 1)
    ends = np.cumsum([0, *(len(stretch.counted) for stretch in stretches)])
    others = []
    for stretch, (first, last) in zip(stretches, pairwise(ends.tolist()), strict=True):
        of_stretch = errors[:, first:last]
        residuals = of_stretch.mean(axis=1, keepdims=True) - of_stretch
        drawn = _drawn_rows(last - first, length, random)
        rows = stretch.counted
        measured = stretch.measured.copy()
        measured[:signals, rows] += of_stretch + inflation * residuals[:, drawn]
        others.append(stretch._replace(measured=measured))
    return tuple(others)


def _drawn_rows(count: int, length: int, random: np.random.Generator) -> np.ndarray:
    """Return as many rows as there are, in blocks of a length; the first row follows the last."""
    starts = random.integers(0, count, -(-count // length))
    rows: np.ndarray = (starts[:, None] + np.arange(length)) % count
    return rows.ravel()[:count]


def half_interval(value: float, fits: Floats) -> float:
    """Return the distance from a value within which 95 % of the fits are, by percentiles."""
    low, high = np.percentile(fits, _PERCENTILES).tolist()
    return float(max(value - low, high - value))
