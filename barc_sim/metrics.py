"""How well a run held its speed: RMS and greatest error, overshoot, settling, per stretch."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from barc_sim.log import Log

#: [m] the run-up from standstill, which no controller within its limits can avoid.
RUN_UP = 10.0
#: The band around the reference in which a step response counts as settled (Åström and Murray,
#: "Feedback Systems", 6.3).
SETTLING_BAND = 0.02


@dataclass(frozen=True)
class Stretch:
    """The speed error over consecutive states on the same grade."""

    start: float  #: [m] along the road, of its first state
    end: float  #: [m] of its last state
    theta_deg: float  #: [deg] incline
    rms_error: float  #: [m/s]
    max_error: float  #: [m/s] greatest absolute error


@dataclass(frozen=True)
class Summary:
    """The true speed against the reference; NaN where there is nothing to tell."""

    rms_error: float  #: [m/s] over all states
    max_error: float  #: [m/s] greatest absolute error
    rms_error_after_run_up: float  #: [m/s] beyond `RUN_UP`
    max_error_after_run_up: float  #: [m/s]
    overshoot: float  #: share of the reference by which the first stretch's speed passes it
    settling_time: float  #: [s] until the speed stays within `SETTLING_BAND` on the first stretch
    missed_deadlines: int
    stretches: tuple[Stretch, ...]


def summary(log: Log) -> Summary:
    """Return what a table or a caption says of a run.

    Overshoot and settling time are those of the step from standstill to the reference, read on
    the first stretch of road, before the first change of grade disturbs it; the settling time is
    NaN where the speed is outside the band at that stretch's end.
    """
    error = log.speed_error
    distance = log.distance
    beyond = error[distance >= RUN_UP]
    stretches = _stretches(log)
    first = stretches[0] if stretches else slice(0)
    return Summary(
        rms_error=_rms(error),
        max_error=_greatest(error),
        rms_error_after_run_up=_rms(beyond),
        max_error_after_run_up=_greatest(beyond),
        overshoot=_overshoot(log.speed[first], log.reference[first]),
        settling_time=_settling_time(log.t[first], error[first], log.reference[first]),
        missed_deadlines=int(np.count_nonzero(log.missed)),
        stretches=tuple(
            Stretch(
                start=float(distance[part][0]),
                end=float(distance[part][-1]),
                theta_deg=float(log.theta_deg[part][0]),
                rms_error=_rms(error[part]),
                max_error=_greatest(error[part]),
            )
            for part in stretches
        ),
    )


def _stretches(log: Log) -> list[slice]:
    """Return the runs of states between changes of grade."""
    if not len(log):
        return []
    before, after = log.theta_deg[:-1], log.theta_deg[1:]
    both_unknown = np.isnan(before) & np.isnan(after)
    changes = np.flatnonzero((before != after) & ~both_unknown) + 1
    bounds = [0, *changes.tolist(), len(log)]
    return [slice(left, right) for left, right in pairwise(bounds)]


def _known(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return values[~np.isnan(values)]


def _rms(error: NDArray[np.float64]) -> float:
    known = _known(error)
    return float(np.sqrt(np.mean(known**2))) if known.size else float('nan')


def _greatest(error: NDArray[np.float64]) -> float:
    known = _known(error)
    return float(np.max(np.abs(known))) if known.size else float('nan')


def _overshoot(speed: NDArray[np.float64], reference: NDArray[np.float64]) -> float:
    if not speed.size or not reference[-1]:
        return float('nan')
    share = np.max(speed * np.sign(reference[-1])) / abs(reference[-1]) - 1.0
    return float(np.fmax(share, 0.0)) if not np.isnan(share) else float('nan')


def _settling_time(
    t: NDArray[np.float64], error: NDArray[np.float64], reference: NDArray[np.float64]
) -> float:
    if np.isnan(error).any() or not error.size:
        return float('nan')
    outside = np.flatnonzero(np.abs(error) > SETTLING_BAND * np.abs(reference))
    settled = outside[-1] + 1 if outside.size else 0
    return float(t[settled] - t[0]) if settled < t.size else float('nan')
