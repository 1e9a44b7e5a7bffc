"""What figures and page draw of a log: its values, its road, limits of axes, and readings."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from barc_sim.simulation.metrics import RUN_UP
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log

_Log = TypeVar('_Log', bound='Log')


def with_zero_for_unknown_errors(log: _Log) -> _Log:
    """Return the log with zero for unknown measurement errors, for figures.

    They draw the measurement where the true value is unknown: at the end of a killed run, and if
    the simulator publishes no errors.
    """
    errors = ('e_s', 'e_ey', 'e_epsi', 'e_v_x', 'e_v_y', 'e_psi_dot')
    return replace(log, **{name: np.nan_to_num(getattr(log, name)) for name in errors})


def driven_road(log: Log) -> Road | None:
    """Return the road that a run has driven; None if it recorded no grade.

    Each change of grade is placed halfway between two states.
    """
    recorded = np.flatnonzero(np.isfinite(log.theta_deg) & np.isfinite(log.distance))
    if not recorded.size:
        return None
    distance, first = np.unique(log.distance[recorded], return_index=True)
    grade = log.theta_deg[recorded][first]
    change = np.flatnonzero(np.diff(grade))
    starts = np.append(distance[0], (distance[change] + distance[change + 1]) / 2.0)
    grades = np.append(grade[0], grade[change + 1])
    has_length = np.append(np.diff(starts) > 0.0, True)
    return Road(starts[has_length], grades[has_length])


def limits(values: NDArray[np.float64], *, share: float, minimum: float) -> tuple[float, float]:
    """Return the limits of an axis around values and zero.

    Parameters
    ----------
    values
        What is drawn; NaN is left out.
    share
        By which share of their range the axis is wider at each end.
    minimum
        The least distance of the farther limit from zero.
    """
    finite = values[np.isfinite(values)]
    low = min(finite.min(initial=0.0), 0.0)
    high = max(finite.max(initial=0.0), 0.0)
    pad = max(share * (high - low), minimum - max(high, -low))
    return low - pad, high + pad


def after_run_up(log: Log, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values after the run-up, so that its large values do not set the limits.

    Return all values of a shorter run.
    """
    after = log.distance >= RUN_UP
    return values[..., after] if after.any() else values


def speed_limits(log: Log) -> tuple[float, float]:
    """Return limits around speed and reference after the run-up."""
    speeds = after_run_up(log, np.stack([log.speed, log.reference]))
    low = float(np.nanmin(speeds))
    high = float(np.nanmax(speeds))
    pad = max(0.1 * (high - low), 0.25)
    return low - pad, high + pad


def reading(value: float, digits: int, unit: str) -> str:
    """Return `value` as text with its unit; a dash for NaN."""
    if np.isnan(value):
        return '\N{EN DASH}'
    # Adding zero turns a negative zero into zero.
    return f'{round(value, digits) + 0.0:.{digits}f}{unit}'.replace('-', '\N{MINUS SIGN}')
