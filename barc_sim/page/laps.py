"""The laps of a run: how well each held the speed, so that two settings can be compared."""

from __future__ import annotations

from dataclasses import asdict
from math import hypot, inf, isfinite, nan
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.simulation.metrics import SpeedErrors

if TYPE_CHECKING:
    from barc_sim.simulation.log import Log
    from barc_sim.simulation.metrics import Summary

_JUMP = 0.5  #: [m] beyond what its speed allows: the car was put somewhere else
_WHOLE = 0.9  #: share of the longest lap from which a lap can be the best
_MOST = 1000  #: laps that are kept
_LONGEST = 1.0  #: [s] between two states of a recorded run, unless time was set anew


class Lap(NamedTuple):
    """A finished lap, or the present one."""

    number: int
    start: float  #: [s] of its first state
    end: float  #: [s] of its last state
    length: float  #: [m] from its first state to its last
    summary: Summary


class Laps:
    """Takes a run's states one by one, and begins a lap wherever the car jumps.

    A reset, a road that begins anew and a car that is put somewhere else are jumps: the position
    changes by more than the speed allows.

    Parameters
    ----------
    longest
        Time [s] between two states in which the car can have moved: where no state is left out, a
        longer one is a reset after a pause.

    Attributes
    ----------
    finished
        The laps before the present one.
    """

    def __init__(self, longest: float = inf) -> None:
        """Start without states."""
        self._longest = longest
        self.finished: list[Lap] = []
        self._errors = SpeedErrors()
        self._number = 0
        self._start = self._before = (nan, 0.0, 0.0, 0.0)  # t, distance, across, speed

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
        before = self._before
        state = (t, distance, across, speed)
        moved = hypot(distance - before[1], across - before[2])
        possible = max(abs(speed), abs(before[3])) * min(abs(t - before[0]), self._longest)
        if moved > possible + _JUMP:
            self.finished.append(self._lap())
            del self.finished[:-_MOST]
            self._errors = SpeedErrors()
            self._number += 1
            self._start = state
        elif before[0] != before[0]:  # the first state
            self._start = state
        self._before = state
        self._errors.add(t, distance, speed, reference, theta_deg)
        return self._number

    def facts(self) -> dict[str, Any]:
        """Return the present lap, the one before, the best and the number of laps, for the page."""
        current = self._lap()
        last = self.finished[-1] if self.finished else None
        return {
            'count': self._number + 1,
            'current': _facts(current),
            'last': last and _facts(last),
            'best': (best := self._best()) and _facts(best),
        }

    def stretches(self) -> list[dict[str, Any]]:
        """Return the table of the present lap's stretches."""
        return [_known(asdict(stretch)) for stretch in self._lap().summary.stretches]

    def _lap(self) -> Lap:
        start, end = self._start, self._before
        length = abs(end[1] - start[1])
        return Lap(self._number, start[0], end[0], length, self._errors.summary())

    def _best(self) -> Lap | None:
        """Return the finished lap with the least RMS error among those that went far enough."""
        laps = [lap for lap in self.finished if isfinite(lap.summary.rms_error_after_run_up)]
        longest = max((lap.length for lap in laps), default=0.0)
        whole = [lap for lap in laps if lap.length >= _WHOLE * longest]
        return min(whole, key=lambda lap: lap.summary.rms_error_after_run_up, default=None)


def laps_of(log: Log) -> tuple[Laps, list[int]]:
    """Return the laps of a recorded run, and the number of each state's lap."""
    laps = Laps(_LONGEST)
    columns = (log.t, log.distance, log.across, log.speed, log.reference, log.theta_deg)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return laps, [laps.add(*row) for row in rows]


def _facts(lap: Lap) -> dict[str, Any]:
    summary = lap.summary
    return _known(
        {
            'number': lap.number,
            'start': lap.start,
            'end': lap.end,
            'rms': summary.rms_error_after_run_up,
            'greatest': summary.max_error_after_run_up,
            'overshoot': summary.overshoot,
            'settling': summary.settling_time,
        }
    )


def _known(fields: dict[str, Any]) -> dict[str, Any]:
    """Return the fields with None for each number that is unknown."""
    return {name: value if isfinite(value) else None for name, value in fields.items()}
