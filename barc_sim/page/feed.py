"""The states of a run for the page, as rows, with ROS and without."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import deque
from math import nan
from typing import TYPE_CHECKING

from barc_sim.page.rows import FIELDS, Rows
from barc_sim.simulation.log import PID_STATE

if TYPE_CHECKING:
    from collections.abc import Callable

    from barc_sim.page.rows import Sample
    from barc_sim.simulation.laps import Laps

NANOSECONDS = 1_000_000_000
_PERIOD = 0.02  #: [s] between two polls
#: [s] after a state at which to poll: its command has come by then, and the next step is far.
_AFTER = 0.006
_GREATEST = 1e12  #: in any unit: a greater value is invalid, and sums of such are not finite
#: [ns] without a state, by the wall clock and by the stamps, after which time has been set anew.
_STILL = NANOSECONDS
_STEP = 20_000_000  #: [ns] that the page shows in place of such a jump
_WINDOW = 4  #: calls over which the real-time factor is measured


class Feed(ABC):
    """The states of a run with their other messages, as rows.

    Attributes
    ----------
    seen
        Number of states taken.
    """

    def __init__(self) -> None:
        """Begin without states."""
        self.seen = 0
        self._rows = Rows()
        self._newest: tuple[int, int] | None = None  # reception and stamp [ns] of a state
        self._window: deque[tuple[int, int]] = deque(maxlen=_WINDOW)

    @abstractmethod
    def _others(self) -> dict[str, list[Sample]]:
        """Return the new samples of the topics in `FIELDS`."""

    @abstractmethod
    def _states(self) -> list[tuple[int, Sample]]:
        """Return the new states, each with the time of its reception [ns]."""

    def poll(self) -> bytes:
        """Return the rows of the new states."""
        rows = self._rows.add((), self._others())
        for received, (stamp, values) in self._states():
            if is_valid(values):
                self._rows.skip(self._stood_still(received, stamp))
                rows += self._rows.add([(stamp, values)], {})
                self._newest = received, stamp
                self.seen += 1
        return rows

    def _stood_still(self, received: int, stamp: int) -> int:
        """Return by how much [ns] stamps have jumped, as a reset after a pause makes them."""
        if self._newest is None:
            return 0
        waited, passed = received - self._newest[0], stamp - self._newest[1]
        return passed - _STEP if min(waited, passed) > _STILL else 0

    def history(self) -> bytes:
        """Return the rows of the last minute."""
        return self._rows.history()

    @property
    def laps(self) -> Laps:
        """The laps of the run so far."""
        return self._rows.laps

    def until_next(self) -> float:
        """Return the time until the next poll [s], a little after the next state is expected."""
        if self._newest is None:
            return _PERIOD
        age = (time.time_ns() - self._newest[0]) / NANOSECONDS
        return min(max(_PERIOD + _AFTER - age, 0.5 * _PERIOD), 1.5 * _PERIOD)

    def realtime_factor(self) -> float | None:
        """Return the simulated seconds per second over the last calls; None before those."""
        if self._newest is None:
            return None
        factor = None
        if len(self._window) == _WINDOW:
            real, simulated = (
                new - old for new, old in zip(self._newest, self._window[0], strict=True)
            )
            factor = simulated / real if real else 0.0
        self._window.append(self._newest)
        return factor


def is_valid(values: tuple[float, ...]) -> bool:
    """Return whether all values are finite, and none is absurd.

    Examples
    --------
    >>> is_valid((8.0, 0.1)), is_valid((float('nan'),))
    (True, False)
    """
    return all(abs(value) <= _GREATEST for value in values)  # False for NaN


def controller_values(value_of: Callable[[str], float]) -> tuple[float, ...]:
    """Return the values of `FIELDS['pid_state']`, NaN for those that are unknown or invalid.

    `value_of` returns a value by name, NaN where it is not known.
    """
    values = map(value_of, FIELDS[PID_STATE])
    return tuple(value if abs(value) <= _GREATEST else nan for value in values)
