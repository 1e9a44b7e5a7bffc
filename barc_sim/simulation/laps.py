"""The laps of a run: how well each held the speed, so that two settings can be compared."""

from __future__ import annotations

from math import hypot, inf, isfinite, isnan, nan
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.simulation.metrics import SpeedErrors

if TYPE_CHECKING:
    from collections.abc import Iterator

    from barc_sim.simulation.log import Log
    from barc_sim.simulation.metrics import Summary

_JUMP = 0.5  #: [m] beyond what its speed allows: the car was put somewhere else
_WHOLE = 0.9  #: share of the longest lap from which a lap can be the best
_MOST = 10_000  #: laps that are kept: those of three days
_LONGEST = 1.0  #: [s] between two states of a recorded run, unless time was set anew
_NEAR = 1e-6  #: [m], [m/s] within which the car is at rest at its start
#: Time [s], distance along and across [m], speed [m/s].
_Place = tuple[float, float, float, float]


class Lap(NamedTuple):
    """A finished lap, or the present one."""

    number: int
    start: float  #: [s] of its first state
    end: float  #: [s] of its last state
    start_distance: float  #: [m] along the road, of its first state
    end_distance: float  #: [m] of its last state
    summary: Summary

    @property
    def length(self) -> float:
        """The distance from its first state to its last [m]."""
        return abs(self.end_distance - self.start_distance)


class Laps:
    """Takes a run's states one by one, and begins a lap wherever the car jumps.

    A reset, a road that begins anew and a car that is put somewhere else are jumps: the position
    changes by more than the speed allows, or time begins anew. Every lap is kept: one that a reset
    has cut short, too.

    Parameters
    ----------
    longest
        Time [s] between two states in which the car can have moved: where no state is left out, a
        longer one is a reset after a pause.

    Attributes
    ----------
    finished
        The laps before the present one.

    Examples
    --------
    >>> laps = Laps()
    >>> [laps.add(t, x, 0.0, 8.0, 8.0, 0.0) for t, x in [(0.0, 9.0), (0.02, 9.16), (0.04, 0.0)]]
    [0, 0, 1]
    """

    def __init__(self, longest: float = inf) -> None:
        """Start without states."""
        self._longest = longest
        self.finished: list[Lap] = []
        self._errors = SpeedErrors()
        self._number = 0
        self._start: _Place = (nan, 0.0, 0.0, 0.0)
        self._before = self._start

    def add(
        self,
        t: float,
        distance: float,
        across: float,
        speed: float,
        reference: float,
        theta_deg: float,
    ) -> int:
        """Take a state: [s], [m], [m], [m/s], [m/s], [deg]; return the number of its lap."""
        before, state = self._before, (t, distance, across, speed)
        if _is_jump(before, state, self._longest):
            self.finished.append(self.current)
            del self.finished[:-_MOST]
            self._errors = SpeedErrors()
            self._number += 1
            self._start = state
        elif isnan(before[0]):  # the first state
            self._start = state
        self._before = state
        self._errors.add(t, distance, speed, reference, theta_deg)
        return self._number

    @property
    def current(self) -> Lap:
        """The present lap."""
        start, end = self._start, self._before
        return Lap(self._number, start[0], end[0], start[1], end[1], self._errors.summary())

    @property
    def last(self) -> Lap | None:
        """The lap before the present one."""
        return self.finished[-1] if self.finished else None

    @property
    def best(self) -> Lap | None:
        """The finished lap with the least RMS error among those that went far enough."""
        laps = [lap for lap in self.finished if isfinite(lap.summary.rms_error_after_run_up)]
        longest = max((lap.length for lap in laps), default=0.0)
        whole = [lap for lap in laps if lap.length >= _WHOLE * longest]
        return min(whole, key=lambda lap: lap.summary.rms_error_after_run_up, default=None)

    def __iter__(self) -> Iterator[Lap]:
        """Yield the laps in their order, the present one last."""
        yield from self.finished
        yield self.current


def _is_jump(before: _Place, now: _Place, longest: float) -> bool:
    """Return whether the car cannot have driven from one place to the next."""
    passed = now[0] - before[0]
    moved = hypot(now[1] - before[1], now[2] - before[2])
    possible = max(abs(now[3]), abs(before[3])) * min(abs(passed), longest)
    # The start, at rest: after a pause, `passed` is long, and much would be possible.
    is_start = max(map(abs, now[1:])) < _NEAR
    return passed < 0.0 or moved > possible + _JUMP or (is_start and moved > _JUMP)


def laps_of(log: Log) -> tuple[Laps, list[int]]:
    """Return the laps of a recorded run, and the number of each state's lap.

    Examples
    --------
    >>> from barc_sim import simulate
    >>> laps, numbers = laps_of(simulate())
    >>> laps.current.number, round(laps.current.length, 1)
    (0, 180.1)
    """
    laps = Laps(_LONGEST)
    columns = (log.t, log.distance, log.across, log.speed, log.reference, log.theta_deg)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return laps, [laps.add(*row) for row in rows]
