"""Joins the topics of a run into rows for the page, one for each state, live or from a log."""

from __future__ import annotations

import struct
import time
from collections import deque
from itertools import chain
from math import cos, hypot, isnan, nan, sin
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.figures.drawn_log import with_zero_for_unknown_errors
from barc_sim.interfaces.stamps import NANOSECONDS, to_nanoseconds
from barc_sim.interfaces.topics import (
    CONTROLLER_STATE,
    ECU,
    ENVIRONMENT,
    LANE_STATE,
    PID_STATE,
    STATE,
    STATE_ERROR,
    TRACK_STATE,
)
from barc_sim.page.protocol import COLUMNS, OTHER_TERMS, TOPICS
from barc_sim.simulation.log import TrackLog, columns_of
from barc_sim.simulation.metrics import Laps, TrackLaps, laps_of, track_laps_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from barc_sim.simulation.log import Log

#: The fields of each topic that a row contains, and their values before the first message.
FIELDS: dict[str, dict[str, float]] = {
    STATE_ERROR: dict.fromkeys(('s', 'ey', 'epsi', 'v_x', 'v_y'), 0.0),
    **{topic: dict.fromkeys(columns_of(topic), nan) for topic in TOPICS},
}
# Terms that only `controller_state` has.
FIELDS[PID_STATE] |= dict.fromkeys(OTHER_TERMS, nan)
#: The topics that a feed takes.
SUBSCRIBED = (STATE, *FIELDS, CONTROLLER_STATE)
_STATE = attrgetter('x', 'y', 'psi', 'v_x', 'v_y')
_GETTERS = {topic: attrgetter(*fields) for topic, fields in FIELDS.items() if topic != PID_STATE}


def _places(fields: Iterable[str]) -> dict[str, int]:
    """Return the place of each field in a topic's values."""
    return {name: place for place, name in enumerate(fields)}


_PLACES = {topic: _places(fields) for topic, fields in FIELDS.items()}
_ROW = struct.Struct(f'<{len(COLUMNS)}d')
_HISTORY = 3000  #: rows that are sent to a page when it opens: a minute
#: Queued messages of a topic, which wait for the server's thread on a busy machine, or for their
#: state: a third of a second at a real-time factor of 6.
DEPTH = 100
_PERIOD = 0.02  #: [s] between two polls
#: [s] from a state to the next poll: its command has arrived, and the next step is still far.
_AFTER = 0.006
_MAX_VALUE = 1e12  #: in any unit: a larger value is invalid, and could make a sum infinite
_WINDOW = 4  #: calls over which the real-time factor is measured


class FeedSample(NamedTuple):
    """The values of a message that waits for its state."""

    stamp: int  #: [ns]
    values: tuple[float, ...]  #: in the order of the topic's `FIELDS`


class NewestState(NamedTuple):
    """When the newest state was received, and its stamp."""

    received: int  #: [ns]
    stamp: int  #: [ns]


class Feed:
    """Joins each state of a run with its other messages into a row; keeps the last minute.

    Messages are any objects with the fields of the topic's type.
    """

    def __init__(self) -> None:
        """Begin without states."""
        self.laps = Laps()  #: of the run so far
        self.track_laps: TrackLaps | None = None  #: None until a track state arrives
        self.plan: list[tuple[float, float]] = []  #: [m] points of the path that the MPC plans

        # Messages on their way into a row, by topic: first as they arrive, then as samples.
        self._arrived: dict[str, deque[Any]] = {topic: deque(maxlen=DEPTH) for topic in SUBSCRIBED}
        self._waiting: dict[str, deque[FeedSample]] = {
            topic: deque(maxlen=DEPTH) for topic in FIELDS
        }
        self._latest = {topic: tuple(fields.values()) for topic, fields in FIELDS.items()}

        # Rows.
        self._first: int | None = None  # stamp [ns] of the first row
        self._newest: NewestState | None = None
        self._history: deque[bytes] = deque(maxlen=_HISTORY)
        self._window: deque[NewestState] = deque(maxlen=_WINDOW)

    def take(self, topic: str, message: Any) -> None:  # noqa: ANN401 (of the topic's type)
        """Store a message that has just arrived; any thread can call this."""
        self._arrived[topic].append((time.time_ns(), message))

    def poll(self) -> bytes:
        """Return the rows of the new states, each with the latest messages up to its stamp.

        A command without a stamp counts from its arrival.
        """
        for topic in (*FIELDS, CONTROLLER_STATE):
            self._queue_samples(topic)

        rows = []
        for received, state in self._drained(STATE):
            stamp = to_nanoseconds(state.header.stamp)
            values = _STATE(state)
            if not _is_valid(values):
                continue
            if self._first is None:
                self._first = stamp
            rows.append(self._row(stamp, *values))
            self._newest = NewestState(received, stamp)

        self._history.extend(rows)
        return b''.join(rows)

    def _queue_samples(self, topic: str) -> None:
        """Turn the messages that have arrived into samples; leave out invalid ones."""
        waiting = self._waiting[PID_STATE if topic == CONTROLLER_STATE else topic]
        for _, message in self._drained(topic):
            values = _values_of(topic, message)
            if values:
                waiting.append(FeedSample(to_nanoseconds(message.header.stamp), values))

    def _drained(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Yield arrival time [ns] and message; meanwhile, another thread may append messages."""
        arrived = self._arrived[topic]
        for _ in range(len(arrived)):
            yield arrived.popleft()

    def _row(self, stamp: int, x: float, y: float, psi: float, v_x: float, v_y: float) -> bytes:
        """Return the row of a state, and add the state to the laps."""
        for topic, waiting in self._waiting.items():
            while waiting and waiting[0].stamp <= stamp:
                self._latest[topic] = waiting.popleft().values

        # The true state is the measured one without the measurement error.
        e_s, e_ey, e_epsi, e_v_x, e_v_y = self._latest[STATE_ERROR]
        heading = psi - e_epsi
        distance = x - (e_s * cos(heading) - e_ey * sin(heading))
        across = y - (e_s * sin(heading) + e_ey * cos(heading))
        speed = v_x - e_v_x

        t = (stamp - (self._first or 0)) / 1e9
        reference = self._field(PID_STATE, 'reference')
        theta_deg = self._field(ENVIRONMENT, 'theta')
        lap = self.laps.add(t, distance, across, speed, reference, theta_deg)
        is_on_track = not isnan(self._latest[TRACK_STATE][0])
        if is_on_track:
            lap = self._add_to_track_laps(t)

        return _ROW.pack(
            t,
            distance,
            across,
            heading,
            speed,
            v_x,
            hypot(speed, v_y - e_v_y),
            lap,
            *chain.from_iterable(self._latest[topic] for topic in TOPICS),
        )

    def _add_to_track_laps(self, t: float) -> int:
        """Add the newest state to the laps of the track; return the number of its lap."""
        if self.track_laps is None:
            self.track_laps = TrackLaps()

        return self.track_laps.add(
            t,
            self._field(TRACK_STATE, 'lap'),
            self._field(TRACK_STATE, 'lap_time'),
            self._field(TRACK_STATE, 'e_y'),
            self._field(ECU, 'servo'),
        )

    def _field(self, topic: str, name: str) -> float:
        """Return the latest value of a topic's field."""
        return self._latest[topic][_PLACES[topic][name]]

    @property
    def time(self) -> float | None:
        """The time of the newest row [s]; None: there is none."""
        if self._first is None or self._newest is None:
            return None
        return (self._newest.stamp - self._first) / NANOSECONDS

    def history(self) -> bytes:
        """Return the rows of the last minute."""
        return b''.join(self._history)

    def until_next(self) -> float:
        """Return the time until the next poll [s], shortly after the expected next state."""
        if self._newest is None:
            return _PERIOD
        age = (time.time_ns() - self._newest.received) / NANOSECONDS
        return min(max(_PERIOD + _AFTER - age, 0.5 * _PERIOD), 1.5 * _PERIOD)

    def realtime_factor(self) -> float | None:
        """Return the simulated seconds per second over the last calls; None at the first calls."""
        if self._newest is None:
            return None

        factor = None
        if len(self._window) == _WINDOW:
            earliest = self._window[0]
            real = self._newest.received - earliest.received
            simulated = self._newest.stamp - earliest.stamp
            factor = simulated / real if real else 0.0

        self._window.append(self._newest)
        return factor


def _is_valid(values: tuple[float, ...]) -> bool:
    """Return whether all values are finite and below the limit."""
    return all(abs(value) <= _MAX_VALUE for value in values)  # False for NaN


def _values_of(topic: str, message: Any) -> tuple[float, ...]:  # noqa: ANN401 (of the topic's type)
    """Return the values of a topic's `FIELDS`; an empty tuple if one is invalid.

    For controllers and lane laws, unknown and invalid values become NaN.
    """
    if topic in (PID_STATE, CONTROLLER_STATE):
        values = _controller_values(message, has_names=topic == CONTROLLER_STATE)
    else:
        values = _GETTERS[topic](message)
        if topic != LANE_STATE:
            return values if _is_valid(values) else ()
    return tuple(value if abs(value) <= _MAX_VALUE else nan for value in values)


def _controller_values(message: Any, *, has_names: bool) -> tuple[float, ...]:  # noqa: ANN401
    """Return the values of the fields of `pid_state`: of the message, or of the terms it names."""
    terms: dict[str, float] = {}
    if has_names:
        terms = dict(zip(message.names, message.values, strict=False))

    values = []
    for name in FIELDS[PID_STATE]:
        if name in terms:
            values.append(terms[name])
        else:
            values.append(getattr(message, name, nan))

    return tuple(values)


def rows_of(log: Log) -> bytes:
    """Return the rows of a whole run."""
    completed = with_zero_for_unknown_errors(log)
    x, y, heading = completed.true_pose
    columns = completed.columns() | {
        't': completed.t,
        'x': x,
        'y': y,
        'psi': heading,
        'speed': completed.speed,
        'measured_speed': completed.v_x,
        'absolute_speed': np.hypot(completed.speed, completed.v_y - completed.e_v_y),
    }
    if isinstance(completed, TrackLog):
        columns['track_lap'] = completed.lap

    _, lap_numbers = laps_in(completed)
    columns['lap'] = np.array(lap_numbers, dtype=float)

    unknown = np.full(len(log), nan)
    shown_columns = [columns.get(name, unknown) for name in columns_in(log)]
    return np.column_stack(shown_columns).astype('<f8').tobytes()


def laps_in(log: Log) -> tuple[Laps | TrackLaps, list[int]]:
    """Return the laps of a run, and the number of each state's lap."""
    return track_laps_of(log) if isinstance(log, TrackLog) else laps_of(log)


def columns_in(log: Log) -> tuple[str, ...]:
    """Return the names of the values in a row of `rows_of(log)`."""
    return (*COLUMNS, *(name for name in log.terms if name not in COLUMNS))
