"""Metrics of a run and its laps: of the speed error, or of the lane on a track."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from itertools import pairwise
from math import hypot, inf, isfinite, isnan, nan, sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.control.cruise_control import LIMIT, PROFILE, SPEED
from barc_sim.control.lane import LANE, STEERING_LIMIT
from barc_sim.interfaces.nodes import CONTROLLER
from barc_sim.simulation.log import TrackLog

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log

    Floats = NDArray[np.float64]

#: [m] the run-up from standstill, which no controller within its limits can avoid.
RUN_UP = 10.0
#: The band around the reference in which a step response counts as settled (Åström and Murray,
#: "Feedback Systems", 6.3).
SETTLING_BAND = 0.02
_MAX_STATES = 500_000  #: of the present lap that count; then the older half is dropped
_JUMP = 0.5  #: [m] farther than its speed allows: the car was put somewhere else
_WHOLE = 0.9  #: share of the longest lap from which a lap can be the best
_MAX_LAPS = 10_000  #: that are kept: those of three days
_MAX_ROWS = 8  #: of a table of laps
_MAX_INTERVAL = 1.0  #: [s] between two states of a recorded run, unless time was set anew
_NEAR = 1e-6  #: [m], [m/s] within which the car is at rest at its start
_AWAY = 1e-3  #: [m] from its start: a car does not come back to rest there without a reset
_SETTLED = 0.25  #: [s] that settings must hold to be shown for a lap
_MAX_GAINS = 4  #: that are shown although none was changed
_MAX_CHANGES = 3  #: values of a parameter that are shown for a lap
#: Parameters of the controller that are no gains.
_NO_GAINS = {each.name for each in (SPEED, LIMIT, *PROFILE)}
#: Headings of a table of laps of a track, `TrackLap.cells`.
LAP_HEADINGS = ('lap', 'time', 'RMS e_y', 'max |e_y|', 'steering')
#: Those of a road, `Lap.cells`; the errors are those beyond `RUN_UP`.
ROAD_LAP_HEADINGS = ('lap', 'time', 'RMS error', 'maximum', 'overshoot', 'settling')


class _Place(NamedTuple):
    """Where the car was, and how fast."""

    t: float  #: [s]
    distance: float  #: [m] along the road
    across: float  #: [m] to its left
    speed: float  #: [m/s]


@dataclass(frozen=True)
class StretchErrors:
    """The speed error over a stretch of the road: consecutive states on the same grade."""

    start: float  #: [m] along the road, of its first state
    end: float  #: [m] of its last state
    theta_deg: float  #: [deg] incline
    rms_error: float  #: [m/s]
    max_error: float  #: [m/s] maximum absolute error


@dataclass(frozen=True)
class Summary:
    """How well a run held the speed, from true speed and reference; NaN if no state counts.

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
    overshoot: float  #: of the speed on the first stretch, as a share of the reference
    settling_time: float  #: [s] until the speed stays within `SETTLING_BAND` on the first stretch
    missed_deadlines: int
    stretches: tuple[StretchErrors, ...]


def summary(log: Log) -> Summary:
    """Return a run's speed errors, overshoot and settling time.

    Parameters
    ----------
    log
        The run.

    Returns
    -------
    Summary
        NaN where no state counts.

    Examples
    --------
    >>> from barc_sim import simulate
    >>> print(f'{summary(simulate()).rms_error_after_run_up:.3f} m/s')
    0.021 m/s
    """
    columns = log.t, log.distance, log.speed, log.reference, log.theta_deg
    return _summary(*columns, int(log.missed.sum()))


def _summary(
    t: Floats,
    distance: Floats,
    speed: Floats,
    reference: Floats,
    theta_deg: Floats,
    missed_deadlines: int = 0,
) -> Summary:
    """Return the summary of states in their order, columns of shape `(n,)`."""
    errors = np.abs(reference - speed)
    unknown = np.isnan(theta_deg)
    changes = (theta_deg[1:] != theta_deg[:-1]) & ~(unknown[1:] & unknown[:-1])
    starts = [0, *(np.flatnonzero(changes) + 1).tolist(), len(t)]
    stretches = [slice(*ends) for ends in pairwise(starts)] if len(t) else []

    rms_error, max_error = _figures(errors)
    rms_after_run_up, max_after_run_up = _figures(errors[distance >= RUN_UP])
    overshoot = nan
    settling_time = nan
    if stretches:
        first = stretches[0]
        overshoot, settling_time = _step_response(t[first], speed[first], reference[first])
    return Summary(
        rms_error=rms_error,
        max_error=max_error,
        rms_error_after_run_up=rms_after_run_up,
        max_error_after_run_up=max_after_run_up,
        overshoot=overshoot,
        settling_time=settling_time,
        missed_deadlines=missed_deadlines,
        stretches=tuple(
            StretchErrors(
                float(distance[each][0]),
                float(distance[each][-1]),
                float(theta_deg[each][0]),
                *_figures(errors[each]),
            )
            for each in stretches
        ),
    )


def _figures(errors: Floats) -> tuple[float, float]:
    """Return RMS and maximum [m/s] of the known errors."""
    valid = errors[~np.isnan(errors)]
    if not len(valid):
        return nan, nan
    return rms(valid), float(valid.max())


def rms(values: Floats) -> float:
    """Return the root mean square.

    The squares are added in the order of the values: so the result is the same on every machine,
    and the same as that of a loop over the values.
    """
    sums = np.add.accumulate(np.square(values))
    return sqrt(float(sums[-1]) / len(values))


def _step_response(t: Floats, speed: Floats, reference: Floats) -> tuple[float, float]:
    """Return overshoot and settling time of the step from standstill to the first reference.

    Only states before the first change of the reference count; the settling time is NaN if the
    speed is outside the band at the end.
    """
    target = float(reference[0])
    changes = np.flatnonzero(reference != target)
    count = changes[0] if changes.size else len(t)
    t = t[:count]
    speed = speed[:count]
    if not len(t) or not target or np.isnan(speed).any():  # no reference, 0, or no speed
        return nan, nan

    outside = np.flatnonzero(np.abs(target - speed) > SETTLING_BAND * abs(target))
    settled = outside[-1] + 1 if outside.size else 0
    settling_time = float(t[settled] - t[0]) if settled < len(t) else nan
    overshoot = max(float((speed / target).max()) - 1.0, 0.0)
    return overshoot, settling_time


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

    @property
    def cells(self) -> tuple[str, ...]:
        """Its number and figures as the texts of a table with `ROAD_LAP_HEADINGS`."""
        results = self.summary
        return (
            f'{self.number + 1}',
            f'{self.end - self.start:.2f} s',
            _cell(results.rms_error_after_run_up, '.3f', ' m/s'),
            _cell(results.max_error_after_run_up, '.3f', ' m/s'),
            _cell(100.0 * results.overshoot, '.1f', ' %'),
            _cell(results.settling_time, '.2f', ' s'),
        )


def _cell(value: float, digits: str, unit: str) -> str:
    return '\N{EN DASH}' if isnan(value) else f'{value:{digits}}{unit}'


class Laps:
    """Takes a run's states one by one, and begins a lap wherever the car jumps.

    A reset, the next lap of a road and a car that is put somewhere else are jumps: the position
    changes by more than the speed allows, or the time restarts. Every lap is kept, even one that a
    reset has cut short.
    """

    def __init__(self, max_interval: float = inf) -> None:
        """Start without states.

        `max_interval` [s] is the maximum time between two states of a lap: if no state is left out,
        a longer one is a reset after a pause.
        """
        self._max_interval = max_interval
        self.finished: list[Lap] = []  #: the laps before the present one
        # Of each state t, distance, speed, reference and theta_deg.
        self._states = array('d')
        self._number = 0
        self._is_over = False
        self._start = _Place(nan, 0.0, 0.0, 0.0)
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
        place = _Place(t, distance, across, speed)
        if _is_jump(self._before, place, self._max_interval):
            self.finished.append(self.current)
            del self.finished[:-_MAX_LAPS]
            self._states = array('d')
            self._number += 1
            self._start = place
        elif isnan(self._before.t):  # the first state
            self._start = place
        self._before = place

        self._states.extend((t, distance, speed, reference, theta_deg))
        if len(self._states) == 5 * _MAX_STATES:
            del self._states[: 5 * _MAX_STATES // 2]
        return self._number

    @property
    def number(self) -> int:
        """The number of the present lap."""
        return self._number

    @property
    def current(self) -> Lap:
        """The present lap; may be read from any thread."""
        start = self._start
        end = self._before
        columns = np.frombuffer(self._states.tobytes()).reshape(-1, 5).T
        return Lap(
            number=self._number,
            start=start.t,
            end=end.t,
            start_distance=start.distance,
            end_distance=end.distance,
            summary=_summary(*columns),
        )

    def end(self) -> None:
        """End the run: from now on the present lap can be the best one, too."""
        self._is_over = True

    @property
    def best(self) -> Lap | None:
        """The lap with the minimum RMS error among those that are long enough.

        The present lap counts only once the run has ended; a run of one lap has no best one.
        """
        candidates = [*self] if self._is_over and self.finished else self.finished
        laps = [lap for lap in candidates if isfinite(lap.summary.rms_error_after_run_up)]
        longest = max((lap.length for lap in laps), default=0.0)
        whole = [lap for lap in laps if lap.length >= _WHOLE * longest]
        return min(whole, key=lambda lap: lap.summary.rms_error_after_run_up, default=None)

    @property
    def rows(self) -> list[Lap]:
        """The laps of a table: the last ones and the best."""
        rows = [*self.finished[1 - _MAX_ROWS :], self.current]
        return rows if self.best is None or self.best in rows else [self.best, *rows[1:]]

    def __iter__(self) -> Iterator[Lap]:
        """Yield the laps in their order, the present one last."""
        yield from self.finished
        yield self.current


def _is_jump(before: _Place, now: _Place, max_interval: float) -> bool:
    """Return whether the car cannot have driven from one place to the next."""
    passed = now.t - before.t
    moved = hypot(now.distance - before.distance, now.across - before.across)
    possible = max(abs(now.speed), abs(before.speed)) * min(abs(passed), max_interval)
    # The start, at rest: after a pause, `passed` is long, and much would be possible. A car that
    # drives in a circle can be reset beside its start.
    is_start = max(abs(now.distance), abs(now.across), abs(now.speed)) < _NEAR
    return passed < 0.0 or moved > possible + _JUMP or (is_start and moved > _AWAY)


def laps_of(log: Log) -> tuple[Laps, list[int]]:
    """Return the laps of a recorded run, and the number of each state's lap."""
    laps = Laps(_MAX_INTERVAL)
    columns = (log.t, log.distance, log.across, log.speed, log.reference, log.theta_deg)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    numbers = [laps.add(*row) for row in rows]
    laps.end()
    return laps, numbers


class Setting(NamedTuple):
    """Values of parameters, and when they held."""

    values: Mapping[str, float]
    start: float  #: [s] of the first state with them
    end: float  #: [s] of the last one


class LapSettings:
    """Collects the settings at the states of a run, such as gains, for each lap.

    Settings that held for less than 0.25 s of a lap are left out, unless no other held longer: a
    preset changes one gain after the other, and is chosen just before the next lap begins.
    """

    def __init__(self) -> None:
        """Begin without laps."""
        self._laps: dict[int, list[Setting]] = {}

    def add(self, lap: int, t: float, values: Mapping[str, float]) -> None:
        """Take the settings at a state of a lap, at `t` [s].

        States at which nothing changed can be left out.
        """
        settings = self._laps.setdefault(lap, [])
        if settings and settings[-1].values == values:
            settings[-1] = settings[-1]._replace(end=t)
        else:
            settings.append(Setting(dict(values), t, t))

    def of(self, lap: int) -> list[Mapping[str, float]]:
        """Return the settings that a lap had, in their order."""
        settings = self._laps.get(lap, [])
        shortest = min(_SETTLED, max((each.end - each.start for each in settings), default=0.0))
        kept = [each.values for each in settings if each.end - each.start >= shortest]
        return [values for k, values in enumerate(kept) if k == 0 or values != kept[k - 1]]

    def text(self, lap: int) -> str:
        """Return the settings of a lap in words, such as `kp 2 → 4, ki 0`; empty if unknown."""
        return settings_text(self.of(lap))


def settings_text(settings: Sequence[Mapping[str, float]]) -> str:
    """Return settings that followed one another in words, such as `kp 2 → 4, ki 0`."""
    names = max(settings, key=len, default={})
    parts = []
    for name in names:
        texts = [f'{values[name]:g}' for values in settings if name in values]
        changes = [text for k, text in enumerate(texts) if k == 0 or text != texts[k - 1]]
        if len(changes) > _MAX_CHANGES:
            changes = [changes[0], '…', changes[-1]]
        if changes:
            parts.append(f'{name} {" → ".join(changes)}')
    return ', '.join(parts)


def settings_of(log: Log) -> dict[str, Floats]:
    """Return the gains of a recorded run over time, by name, and what else was changed in it.

    They are the gains of the speed controller, or on a track of the steering law. If there are
    many gains, only changed ones are returned.
    """
    gains = {}
    changed = {}
    for full_name, values in log.parameters.items():
        node, _, name = full_name.partition('.')
        of_lane = name.startswith(LANE)
        short = name.removeprefix(LANE)
        if node == CONTROLLER and name not in _NO_GAINS and of_lane == isinstance(log, TrackLog):
            gains[short] = values
        numbers = values[~np.isnan(values)]
        if numbers.size and numbers.min() < numbers.max():
            changed[short] = values
    return gains | changed if len(gains) <= _MAX_GAINS else changed


def lap_settings_of(log: Log, numbers: Sequence[int]) -> LapSettings:
    """Return the settings of each lap of a recorded run; `numbers` has the lap of each state."""
    columns = settings_of(log)
    rows = np.array([numbers, *columns.values()])
    changes = (rows[:, 1:] != rows[:, :-1]) & ~(np.isnan(rows[:, 1:]) & np.isnan(rows[:, :-1]))
    first = [0, *(np.flatnonzero(changes.any(axis=0)) + 1).tolist(), len(numbers)]
    laps = LapSettings()
    for begin, end in pairwise(first):
        values = {name: float(column[begin]) for name, column in columns.items()}
        settings = {name: value for name, value in values.items() if not isnan(value)}
        for k in (begin, end - 1):
            laps.add(int(numbers[k]), float(log.t[k]), settings)
    return laps


def changes_of(log: Log) -> dict[str, str]:
    """Return each parameter that was changed during a run in words, such as `kp 2 → 4`."""
    run = lap_settings_of(log, [0] * len(log)).of(0)
    texts = {}
    for name in settings_of(log):
        values = [{name: each[name]} for each in run if name in each]
        if any(each != values[0] for each in values):
            texts[name] = settings_text(values)
    return texts


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

    @property
    def cells(self) -> tuple[str, ...]:
        """Its number and figures as the texts of a table with `LAP_HEADINGS`."""
        number = f'{self.number + 1}' if self.is_finished else 'not finished'
        return (
            number,
            f'{self.time:.2f} s',
            f'{self.rms:.3f} m',
            f'{self.maximum:.3f} m',
            f'{self.at_limit:.0%} at its limit',
        )


class TrackLaps:
    """Takes the states of a run on a track one by one; a reset begins a lap, too."""

    def __init__(self) -> None:
        """Begin without states."""
        self.finished: list[TrackLap] = []  #: without those that a reset has cut short
        self._number = -1
        self._start = nan
        self._end = nan
        self._lap = nan  # of the state before
        self._lap_time = nan  # [s]
        self._clear_sums()

    def _clear_sums(self) -> None:
        """Begin the sums over the states of a lap."""
        self._states = 0
        self._squares = 0.0
        self._maximum = 0.0
        self._at_limit = 0

    def add(self, t: float, lap: float, lap_time: float, e_y: float, servo: float) -> int:
        """Take a state, its values as in `TrackLog`; return the number of its lap."""
        if isnan(lap):  # its place is not known
            return max(self._number, 0)

        if lap != self._lap or lap_time < self._lap_time:  # the first state, too
            if lap == self._lap + 1.0:
                self._end = t - lap_time
                self.finished.append(self.current._replace(is_finished=True))
                del self.finished[:-_MAX_LAPS]
            self._start = t - lap_time
            self._number += 1
            self._clear_sums()
        self._lap = lap
        self._lap_time = lap_time
        self._end = t

        self._states += 1
        self._squares += e_y * e_y
        self._maximum = max(self._maximum, abs(e_y))
        self._at_limit += abs(servo) >= STEERING_LIMIT
        return self._number

    @property
    def number(self) -> int:
        """The number of the present lap."""
        return self._number

    @property
    def current(self) -> TrackLap:
        """The present lap."""
        n = max(self._states, 1)
        return TrackLap(
            number=self._number,
            start=self._start,
            end=self._end,
            is_finished=False,
            rms=sqrt(self._squares / n),
            maximum=self._maximum,
            at_limit=self._at_limit / n,
        )

    @property
    def rows(self) -> list[TrackLap]:
        """The laps of a table: the last finished ones and the best; else the present one."""
        rows = self.finished[-_MAX_ROWS:] or [self.current]
        return rows if self.best is None or self.best in rows else [self.best, *rows[1:]]

    @property
    def best(self) -> TrackLap | None:
        """The fastest finished lap except the first, unless that is the only one."""
        laps = self.finished[1:] or self.finished
        return min(laps, key=lambda lap: lap.time, default=None)


def track_laps_of(log: TrackLog) -> tuple[TrackLaps, list[int]]:
    """Return the laps of a recorded run on a track, and the number of each state's lap."""
    laps = TrackLaps()
    columns = (log.t, log.lap, log.lap_time, log.e_y, log.servo)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return laps, [laps.add(*row) for row in rows]
