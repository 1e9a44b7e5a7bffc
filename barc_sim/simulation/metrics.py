"""How well a run and its laps held the speed, or kept the lane of a track."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, inf, isfinite, isnan, nan, sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.control.lane import STEERING_LIMIT

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log, TrackLog

    Floats = NDArray[np.float64]

#: [m] the run-up from standstill, which no controller within its limits can avoid.
RUN_UP = 10.0
#: The band around the reference in which a step response counts as settled (Åström and Murray,
#: "Feedback Systems", 6.3).
SETTLING_BAND = 0.02
_BLOCK = 2048  # states that are added to the sums at once
_JUMP = 0.5  #: [m] beyond what its speed allows: the car was put somewhere else
_WHOLE = 0.9  #: share of the longest lap from which a lap can be the best
_MAX_LAPS = 10_000  #: that are kept: those of three days
_MAX_INTERVAL = 1.0  #: [s] between two states of a recorded run, unless time was set anew
_NEAR = 1e-6  #: [m], [m/s] within which the car is at rest at its start
#: Time [s], distance along and across [m], speed [m/s].
_Place = tuple[float, float, float, float]


@dataclass(frozen=True)
class SegmentErrors:
    """The speed error over consecutive states on the same grade."""

    start: float  #: [m] along the road, of its first state
    end: float  #: [m] of its last state
    theta_deg: float  #: [deg] incline
    rms_error: float  #: [m/s]
    max_error: float  #: [m/s] maximum absolute error


@dataclass(frozen=True)
class Summary:
    """The true speed against the reference; NaN where no state counts.

    Examples
    --------
    >>> from barc_sim import simulate, summary
    >>> found = summary(simulate(kp=10.0, ki=20.0, kd=0.0))
    >>> print(f'{found.overshoot:.1%}, steepest: {found.stretches[5].max_error:.3f} m/s')
    1.0%, steepest: 0.380 m/s
    """

    rms_error: float  #: [m/s] over all states
    max_error: float  #: [m/s] maximum absolute error
    rms_error_after_run_up: float  #: [m/s] beyond `RUN_UP`
    max_error_after_run_up: float  #: [m/s]
    overshoot: float  #: share of the reference by which the first segment's speed passes it
    settling_time: float  #: [s] until the speed stays within `SETTLING_BAND` on the first segment
    missed_deadlines: int
    stretches: tuple[SegmentErrors, ...]


class _Errors(NamedTuple):
    """The absolute errors [m/s] over some states; those that are NaN do not count."""

    number: int = 0
    squares: float = 0.0  #: their sum
    maximum: float = 0.0

    @classmethod
    def of(cls, errors: Floats) -> _Errors:
        known = errors[~np.isnan(errors)]
        return cls(len(known), float(known @ known), float(known.max(initial=0.0)))

    def plus(self, other: _Errors) -> _Errors:
        maximum = max(self.maximum, other.maximum)
        return _Errors(self.number + other.number, self.squares + other.squares, maximum)

    @property
    def figures(self) -> tuple[float, float]:
        """RMS and maximum error [m/s]."""
        return (sqrt(self.squares / self.number), self.maximum) if self.number else (nan, nan)


class _Segment(NamedTuple):
    """Consecutive states on the same grade."""

    theta_deg: float
    start: float
    end: float
    errors: _Errors

    def goes_on_in(self, other: _Segment) -> bool:
        """Return whether `other`, the next, has the same grade, or both are unknown."""
        grades = self.theta_deg, other.theta_deg
        return grades[0] == grades[1] or all(map(isnan, grades))

    def plus(self, other: _Segment) -> _Segment:
        start = other.start if isnan(self.start) else self.start
        return _Segment(self.theta_deg, start, other.end, self.errors.plus(other.errors))


class _Sums(NamedTuple):
    """What a `Summary` is made of.

    Overshoot and settling time are those of the step from standstill to the reference, read on
    the first segment of road, before the first change of grade or reference; the settling time is
    NaN where the speed is outside the band at the end of that part.
    """

    all: _Errors = _Errors()
    after_run_up: _Errors = _Errors()
    segments: tuple[_Segment, ...] = ()
    begin: float = nan  #: [s]
    peak: float = nan  #: maximum speed on the first segment, as a share of the reference
    settled_at: float = nan  #: [s]
    reference: float = nan  #: [m/s] of the step response
    has_changed: bool = False  #: whether there has been another reference

    def plus(
        self, t: Floats, distance: Floats, speed: Floats, reference: Floats, theta_deg: Floats
    ) -> _Sums:
        """Return these and more states, shape `(n,)` each, in their order."""
        if not len(t):
            return self
        errors = np.abs(reference - speed)
        unknown = np.isnan(theta_deg)
        changes = (theta_deg[1:] != theta_deg[:-1]) & ~(unknown[1:] & unknown[:-1])
        starts = np.concatenate([[0], np.flatnonzero(changes) + 1])
        before, new = [*self.segments], _segments(starts, distance, theta_deg, errors)
        if before and before[-1].goes_on_in(new[0]):
            new[0] = before.pop().plus(new[0])
        sums = _Sums(
            self.all.plus(_Errors.of(errors)),
            self.after_run_up.plus(_Errors.of(errors[distance >= RUN_UP])),
            (*before, *new),
            *self[3:],
        )
        if not before and not self.has_changed:
            first = slice(starts[1] if len(starts) > 1 else None)
            sums = sums._with_step_response(t[first], speed[first], reference[first])
        return sums

    def _with_step_response(self, t: Floats, speed: Floats, reference: Floats) -> _Sums:
        """Return these with states of the first segment, up to a change of the reference."""
        held = float(reference[0]) if isnan(self.begin) else self.reference
        changed = np.flatnonzero((reference != held) & (not isnan(held)))[:1]
        if changed.size:
            t, speed, reference = (each[: changed[0]] for each in (t, speed, reference))
        if not len(t):
            return self._replace(has_changed=True)
        share = np.divide(speed, reference, out=np.full(len(t), nan), where=reference != 0.0)
        before = -inf if isnan(self.begin) else self.peak
        peak = float(np.maximum(before, share.max()))  # NaN where one is
        inside = np.abs(reference - speed) <= SETTLING_BAND * np.abs(reference)
        outside = np.flatnonzero(~inside)
        settled_at = self.settled_at
        if outside.size:
            settled_at = float(t[outside[-1] + 1]) if outside[-1] + 1 < len(t) else nan
        elif isnan(settled_at):
            settled_at = float(t[0])
        begin = float(t[0]) if isnan(self.begin) else self.begin
        has_changed = bool(changed.size)
        return _Sums(*self[:3], begin, peak, settled_at, held, has_changed)

    def summary(self, missed_deadlines: int) -> Summary:
        """Return the summary of the states."""
        is_unknown = isnan(self.peak)
        return Summary(
            *self.all.figures,
            *self.after_run_up.figures,
            overshoot=nan if is_unknown else max(self.peak - 1.0, 0.0),
            settling_time=nan if is_unknown else self.settled_at - self.begin,
            missed_deadlines=missed_deadlines,
            stretches=tuple(
                SegmentErrors(each.start, each.end, each.theta_deg, *each.errors.figures)
                for each in self.segments
            ),
        )


def _segments(
    starts: NDArray[np.intp], distance: Floats, theta_deg: Floats, errors: Floats
) -> list[_Segment]:
    """Return the segments that begin at the states `starts`."""
    known = ~np.isnan(errors)
    errors = np.where(known, errors, 0.0)
    # The first distance that is known; the NaN at the end where none is.
    places = np.where(np.isnan(distance), len(errors), np.arange(len(errors)))
    columns = (
        theta_deg[starts],
        np.append(distance, nan)[np.minimum.reduceat(places, starts)],
        distance[np.append(starts[1:], len(errors)) - 1],
        np.add.reduceat(known, starts, dtype=np.intp),
        np.add.reduceat(errors * errors, starts),
        np.maximum.reduceat(errors, starts),
    )
    rows = zip(*(each.tolist() for each in columns), strict=True)
    return [_Segment(grade, start, end, _Errors(*sums)) for grade, start, end, *sums in rows]


def summary(log: Log) -> Summary:
    """Return how well a run held its speed.

    Examples
    --------
    >>> from barc_sim import simulate
    >>> print(f'{summary(simulate()).rms_error_after_run_up:.3f} m/s')
    0.021 m/s
    """
    sums, columns = _Sums(), (log.t, log.distance, log.speed, log.reference, log.theta_deg)
    for start in range(0, len(log), _BLOCK):  # in the blocks of `SpeedErrors`: to the last bit
        sums = sums.plus(*(column[start : start + _BLOCK] for column in columns))
    return sums.summary(int(log.missed.sum()))


class SpeedErrors:
    """Computes the `Summary` of a run, state by state; any thread may ask for it meanwhile."""

    def __init__(self) -> None:
        """Begin without states."""
        # Both at once, for other threads: the sums, and the states that are not yet part of them.
        self._parts: tuple[_Sums, list[tuple[float, ...]]] = _Sums(), []

    def add(
        self, t: float, distance: float, speed: float, reference: float, theta_deg: float
    ) -> None:
        """Take a state: [s], [m], [m/s], [m/s], [deg]."""
        _, states = self._parts
        states.append((t, distance, speed, reference, theta_deg))
        if len(states) == _BLOCK:
            self._parts = self._sums(), []

    def summary(self, missed_deadlines: int = 0) -> Summary:
        """Return the summary of the states so far."""
        return self._sums().summary(missed_deadlines)

    def _sums(self) -> _Sums:
        sums, states = self._parts
        return sums.plus(*np.array(tuple(states), dtype=np.float64).reshape(-1, 5).T)


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
    """

    def __init__(self, max_interval: float = inf) -> None:
        """Start without states.

        `max_interval` [s] is the time between two states in which the car can have moved: where no
        state is left out, a longer one is a reset after a pause.
        """
        self._max_interval = max_interval
        self.finished: list[Lap] = []  #: the laps before the present one
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
        if _is_jump(before, state, self._max_interval):
            self.finished.append(self.current)
            del self.finished[:-_MAX_LAPS]
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
        """The finished lap with the minimum RMS error among those that went far enough."""
        laps = [lap for lap in self.finished if isfinite(lap.summary.rms_error_after_run_up)]
        longest = max((lap.length for lap in laps), default=0.0)
        whole = [lap for lap in laps if lap.length >= _WHOLE * longest]
        return min(whole, key=lambda lap: lap.summary.rms_error_after_run_up, default=None)

    def __iter__(self) -> Iterator[Lap]:
        """Yield the laps in their order, the present one last."""
        yield from self.finished
        yield self.current


def _is_jump(before: _Place, now: _Place, max_interval: float) -> bool:
    """Return whether the car cannot have driven from one place to the next."""
    passed = now[0] - before[0]
    moved = hypot(now[1] - before[1], now[2] - before[2])
    possible = max(abs(now[3]), abs(before[3])) * min(abs(passed), max_interval)
    # The start, at rest: after a pause, `passed` is long, and much would be possible.
    is_start = max(map(abs, now[1:])) < _NEAR
    return passed < 0.0 or moved > possible + _JUMP or (is_start and moved > _JUMP)


def laps_of(log: Log) -> tuple[Laps, list[int]]:
    """Return the laps of a recorded run, and the number of each state's lap."""
    laps = Laps(_MAX_INTERVAL)
    columns = (log.t, log.distance, log.across, log.speed, log.reference, log.theta_deg)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return laps, [laps.add(*row) for row in rows]


class TrackLap(NamedTuple):
    """A lap of a track, which begins and ends between two states."""

    number: int  #: counts resets, too
    start: float  #: [s]
    end: float  #: [s]; of a lap that is not finished, the time of its last state
    is_finished: bool
    rms: float  #: [m] of e_y
    maximum: float  #: [m] of |e_y|
    at_limit: float  #: share of the states in which the steering command is at its limit

    @property
    def time(self) -> float:
        """The time of a finished lap [s], else that up to now."""
        return self.end - self.start


class TrackLaps:
    """Takes the states of a run on a track one by one; a reset begins a lap, too."""

    def __init__(self) -> None:
        """Begin without states."""
        self.finished: list[TrackLap] = []  #: without those that a reset has cut short
        self._number = 0
        self._start = self._end = nan
        self._before = (nan, nan)  # lap and its time [s]
        self._states, self._squares, self._maximum, self._at_limit = 0, 0.0, 0.0, 0

    def add(self, t: float, lap: float, lap_time: float, e_y: float, servo: float) -> int:
        """Take a state, its values as in `TrackLog`; return the number of its lap."""
        before = self._before
        if isnan(self._start):
            self._start = t - lap_time
        elif lap != before[0] or lap_time < before[1]:
            if lap == before[0] + 1.0:
                self._end = t - lap_time
                self.finished.append(self.current._replace(is_finished=True))
                del self.finished[:-_MAX_LAPS]
            self._start = t - lap_time
            self._number += 1
            self._states, self._squares, self._maximum, self._at_limit = 0, 0.0, 0.0, 0
        self._before, self._end = (lap, lap_time), t
        self._states += 1
        self._squares += e_y * e_y
        self._maximum = max(self._maximum, abs(e_y))
        self._at_limit += abs(servo) >= STEERING_LIMIT
        return self._number

    @property
    def current(self) -> TrackLap:
        """The present lap."""
        n = max(self._states, 1)
        figures = sqrt(self._squares / n), self._maximum, self._at_limit / n
        return TrackLap(self._number, self._start, self._end, False, *figures)

    @property
    def best(self) -> TrackLap | None:
        """The fastest finished lap but the first, unless that is the only one."""
        laps = self.finished[1:] or self.finished
        return min(laps, key=lambda lap: lap.time, default=None)


def track_laps_of(log: TrackLog) -> tuple[TrackLaps, list[int]]:
    """Return the laps of a recorded run on a track, and the number of each state's lap."""
    laps = TrackLaps()
    columns = (log.t, log.lap, log.lap_time, log.e_y, log.servo)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return laps, [laps.add(*row) for row in rows]
