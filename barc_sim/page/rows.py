"""Samples of a run's topics -> the rows that are sent to the page."""

from __future__ import annotations

import struct
from collections import deque
from math import cos, hypot, nan, sin
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.figures.style import use_measurement
from barc_sim.page.protocol import COLUMNS, OTHER_TERMS, TOPICS
from barc_sim.simulation.laps import Laps, laps_of
from barc_sim.simulation.log import ENVIRONMENT, PID_STATE, STATE_ERROR, columns_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from barc_sim.simulation.log import Log

    #: [ns] stamp, and values in the order of `FIELDS`.
    Sample = tuple[int, tuple[float, ...]]

#: The fields of each topic that belong to a state, and their values before its first message.
FIELDS: dict[str, dict[str, float]] = {
    STATE_ERROR: dict.fromkeys(('s', 'ey', 'epsi', 'v_x', 'v_y'), 0.0),
    **{topic: dict.fromkeys(columns_of(topic), nan) for topic in TOPICS},
}
# What `controller_state` holds beyond the fields of `pid_state`.
FIELDS[PID_STATE] |= dict.fromkeys(OTHER_TERMS, nan)
STATE_FIELDS = ('x', 'y', 'psi', 'v_x', 'v_y')
_REFERENCE = [*FIELDS[PID_STATE]].index('reference')
_THETA = [*FIELDS[ENVIRONMENT]].index('theta')
_ROW = struct.Struct(f'<{len(COLUMNS)}d')
_HISTORY = 3000  #: rows that are sent to a page when it opens: a minute
_WAITING = 100  #: samples per topic that wait for their state


class Rows:
    """Joins the samples of each state, and keeps the rows of the last minute."""

    def __init__(self) -> None:
        """Start without states."""
        self.laps = Laps()
        self._first: int | None = None
        self._latest = {topic: tuple(fields.values()) for topic, fields in FIELDS.items()}
        self._waiting: dict[str, deque[Sample]] = {
            topic: deque(maxlen=_WAITING) for topic in FIELDS
        }
        self._history: deque[bytes] = deque(maxlen=_HISTORY)

    def add(self, states: Iterable[Sample], others: Mapping[str, Iterable[Sample]]) -> bytes:
        """Return the rows of `states`, each with the latest of the others that is not newer.

        A command without a stamp holds from its arrival.
        """
        for topic, samples in others.items():
            self._waiting[topic].extend(samples)
        rows = [self._row(stamp, values) for stamp, values in states]
        self._history.extend(rows)
        return b''.join(rows)

    def skip(self, gap: int) -> None:
        """Leave `gap` [ns] of the stamps before the next one out of the time of the rows."""
        if self._first is not None:
            self._first += gap

    def history(self) -> bytes:
        """Return the rows of the last minute."""
        return b''.join(self._history)

    def _row(self, stamp: int, values: tuple[float, ...]) -> bytes:
        if self._first is None:
            self._first = stamp
        for topic, waiting in self._waiting.items():
            while waiting and waiting[0][0] <= stamp:
                self._latest[topic] = waiting.popleft()[1]
        x, y, psi, v_x, v_y = values
        s, ey, epsi, e_v_x, e_v_y = self._latest[STATE_ERROR]
        heading = psi - epsi
        t = (stamp - self._first) / 1e9
        distance = x - (s * cos(heading) - ey * sin(heading))
        across = y - (s * sin(heading) + ey * cos(heading))
        speed = v_x - e_v_x
        reference = self._latest[PID_STATE][_REFERENCE]
        theta_deg = self._latest[ENVIRONMENT][_THETA]
        lap = self.laps.add(t, distance, across, speed, reference, theta_deg)
        return _ROW.pack(
            t,
            distance,
            across,
            heading,
            speed,
            v_x,
            hypot(speed, v_y - e_v_y),
            lap,
            *(value for topic in TOPICS for value in self._latest[topic]),
        )


def rows_of(log: Log) -> bytes:
    """Return a whole run's rows."""
    known = use_measurement(log)
    heading = known.psi - known.e_epsi
    columns = known.columns() | {
        't': known.t,
        'x': known.distance,
        'y': known.y - (known.e_s * np.sin(heading) + known.e_ey * np.cos(heading)),
        'psi': heading,
        'speed': known.speed,
        'measured_speed': known.v_x,
        'absolute_speed': np.hypot(known.speed, known.v_y - known.e_v_y),
        'lap': np.array(laps_of(known)[1], dtype=float),
    }
    absent = np.full(len(log), nan)
    rows = [columns.get(name, absent) for name in columns_in(log)]
    return np.column_stack(rows).astype('<f8').tobytes()


def columns_in(log: Log) -> tuple[str, ...]:
    """Return the names of the values in a row of `rows_of(log)`.

    Examples
    --------
    >>> from barc_sim import simulate
    >>> columns_in(simulate())[:3]
    ('t', 'x', 'y')
    """
    return (*COLUMNS, *(name for name in log.terms if name not in COLUMNS))
