"""How well a run held its speed: RMS and greatest error, overshoot, settling, per stretch."""

from __future__ import annotations

from dataclasses import dataclass
from math import isnan, nan, sqrt
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from barc_sim.simulation.log import Log

#: [m] the run-up from standstill, which no controller within its limits can avoid.
RUN_UP = 10.0
#: The band around the reference in which a step response counts as settled (Åström and Murray,
#: "Feedback Systems", 6.3).
SETTLING_BAND = 0.02


@dataclass(frozen=True)
class SegmentErrors:
    """The speed error over consecutive states on the same grade.

    Examples
    --------
    >>> from barc_sim import simulate
    >>> steepest = summary(simulate()).stretches[5]
    >>> steepest.theta_deg, round(steepest.max_error, 3)
    (30.0, 0.126)
    """

    start: float  #: [m] along the road, of its first state
    end: float  #: [m] of its last state
    theta_deg: float  #: [deg] incline
    rms_error: float  #: [m/s]
    max_error: float  #: [m/s] greatest absolute error


@dataclass(frozen=True)
class Summary:
    """The true speed against the reference; NaN where no state counts.

    Examples
    --------
    >>> from barc_sim import simulate
    >>> print(f'{summary(simulate(kp=10.0, ki=20.0, kd=0.0)).overshoot:.1%}')
    1.0%
    """

    rms_error: float  #: [m/s] over all states
    max_error: float  #: [m/s] greatest absolute error
    rms_error_after_run_up: float  #: [m/s] beyond `RUN_UP`
    max_error_after_run_up: float  #: [m/s]
    overshoot: float  #: share of the reference by which the first stretch's speed passes it
    settling_time: float  #: [s] until the speed stays within `SETTLING_BAND` on the first stretch
    missed_deadlines: int
    stretches: tuple[SegmentErrors, ...]


class SpeedErrors:
    """Computes the `Summary` of a run, state by state.

    Overshoot and settling time are those of the step from standstill to the reference, read on
    the first stretch of road, before the first change of grade disturbs it; the settling time is
    NaN where the speed is outside the band at that stretch's end.

    Examples
    --------
    >>> errors = SpeedErrors()
    >>> errors.add(t=0.0, distance=0.0, speed=7.0, reference=8.0, theta_deg=0.0)
    >>> errors.summary().rms_error
    1.0
    """

    def __init__(self) -> None:
        """Begin without states."""
        self._all = _Errors()
        self._after_run_up = _Errors()
        self._stretches: list[_Errors] = []
        self._start = nan
        self._peak = nan  # greatest speed on the first stretch, as a share of the reference
        self._settled_at = nan

    def add(
        self, t: float, distance: float, speed: float, reference: float, theta_deg: float
    ) -> None:
        """Take a state: [s], [m], [m/s], [m/s], [deg]."""
        error = reference - speed
        self._all.add(distance, error)
        if distance >= RUN_UP:
            self._after_run_up.add(distance, error)
        if not self._stretches or not self._stretches[-1].is_on(theta_deg):
            self._stretches.append(_Errors(theta_deg))
        self._stretches[-1].add(distance, error)
        if len(self._stretches) == 1:
            self._add_step_response(t, speed, reference)

    def _add_step_response(self, t: float, speed: float, reference: float) -> None:
        share = speed / reference if reference else nan
        if isnan(self._start):
            self._start, self._peak = t, share
        elif isnan(share) or share > self._peak:
            self._peak = share
        if not abs(reference - speed) <= SETTLING_BAND * abs(reference):
            self._settled_at = nan
        elif isnan(self._settled_at):
            self._settled_at = t

    def summary(self, missed_deadlines: int = 0) -> Summary:
        """Return the summary of the states so far."""
        return Summary(
            rms_error=self._all.rms,
            max_error=self._all.greatest,
            rms_error_after_run_up=self._after_run_up.rms,
            max_error_after_run_up=self._after_run_up.greatest,
            overshoot=self._peak if isnan(self._peak) else max(self._peak - 1.0, 0.0),
            settling_time=nan if isnan(self._peak) else self._settled_at - self._start,
            missed_deadlines=missed_deadlines,
            stretches=tuple(
                SegmentErrors(part.first, part.last, part.theta_deg, part.rms, part.greatest)
                for part in self._stretches
            ),
        )


def summary(log: Log) -> Summary:
    """Return how well a run held its speed.

    Examples
    --------
    >>> from barc_sim import simulate
    >>> print(f'{summary(simulate()).rms_error_after_run_up:.3f} m/s')
    0.021 m/s
    """
    errors = SpeedErrors()
    columns = (log.t, log.distance, log.speed, log.reference, log.theta_deg)
    for row in zip(*(column.tolist() for column in columns), strict=True):
        errors.add(*row)
    return errors.summary(int(log.missed.sum()))


class _Errors:
    """The errors [m/s] over some states; those that are NaN do not count."""

    def __init__(self, theta_deg: float = nan) -> None:
        self.theta_deg = theta_deg
        self.first = self.last = nan
        self._count = 0
        self._squares = 0.0
        self._greatest = 0.0

    def is_on(self, theta_deg: float) -> bool:
        return self.theta_deg == theta_deg or (isnan(self.theta_deg) and isnan(theta_deg))

    def add(self, distance: float, error: float) -> None:
        if isnan(self.first):
            self.first = distance
        self.last = distance
        if not isnan(error):
            self._count += 1
            self._squares += error * error
            self._greatest = max(self._greatest, abs(error))

    @property
    def rms(self) -> float:
        return sqrt(self._squares / self._count) if self._count else nan

    @property
    def greatest(self) -> float:
        return self._greatest if self._count else nan
