"""Polls the topics of a run and joins their messages to the rows of the page."""

from __future__ import annotations

import time
from collections import deque
from math import nan
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from barc_interfaces.msg import ECU, ControllerState, Environment, EZDynBkMdl, PidState, ZDynBkMdl

from barc_sim.page.rows import FIELDS, STATE_FIELDS, Rows
from barc_sim.ros import names
from barc_sim.ros.conversions import NANOSECONDS, to_nanoseconds
from barc_sim.ros.executor import PolledCallbackGroup
from barc_sim.ros.polled import polled, take

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

    from barc_sim.page.laps import Laps
    from barc_sim.page.rows import Sample

_TYPES = {
    names.STATE_ERROR: EZDynBkMdl,
    names.ENVIRONMENT: Environment,
    names.ECU: ECU,
    names.PID_STATE: PidState,
    names.CONTROLLER_STATE: ControllerState,
}
_STATE_VALUES: Callable[[Any], tuple[float, ...]] = attrgetter(*STATE_FIELDS)
_OF_CONTROLLER = (names.PID_STATE, names.CONTROLLER_STATE)
_VALUES: dict[str, Callable[[Any], tuple[float, ...]]] = {
    topic: attrgetter(*fields) for topic, fields in FIELDS.items()
}
#: Queue length of a subscription: more states than come between two polls.
_DEPTH = 16
_PERIOD = 0.02  #: [s] between two polls
#: [s] after a state at which to poll: its command has come by then, and the next step is far.
_AFTER = 0.006
_GREATEST = 1e12  #: in any unit: a greater value is invalid, and sums of such are not finite
_WINDOW = 4  #: calls over which the real-time factor is measured


class StateFeed:
    """The states of a run with their other messages, as rows.

    Attributes
    ----------
    seen
        Number of states taken.
    """

    def __init__(self, node: Node) -> None:
        """Subscribe with `node`."""
        self.seen = 0
        self._rows = Rows()
        self._newest: tuple[int, int] | None = None  # reception and stamp [ns] of a state
        self._window: deque[tuple[int, int]] = deque(maxlen=_WINDOW)
        group = PolledCallbackGroup()
        self._states = polled(node, ZDynBkMdl, names.STATE, _DEPTH, group)
        self._others = {
            topic: polled(node, kind, topic, _DEPTH, group) for topic, kind in _TYPES.items()
        }

    def poll(self) -> bytes:
        """Return the rows of the new states."""
        others: dict[str, list[Sample]] = {topic: [] for topic in FIELDS}
        for topic, subscription in self._others.items():
            of_controller = topic in _OF_CONTROLLER
            samples = others[names.PID_STATE if of_controller else topic]
            for message, _ in take(subscription, _DEPTH):
                values = _controller_values(message) if of_controller else _VALUES[topic](message)
                if of_controller or _is_valid(values):
                    samples.append((to_nanoseconds(message.header.stamp), values))
        states = []
        for message, info in take(self._states, _DEPTH):
            values = _STATE_VALUES(message)
            if not _is_valid(values):
                continue
            stamp = to_nanoseconds(message.header.stamp)
            states.append((stamp, values))
            self._newest = info['received_timestamp'], stamp
        self.seen += len(states)
        return self._rows.add(states, others)

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


def _is_valid(values: tuple[float, ...]) -> bool:
    return all(abs(value) <= _GREATEST for value in values)  # False for NaN


def _controller_values(message: PidState | ControllerState) -> tuple[float, ...]:
    """Return the values of `FIELDS['pid_state']`, NaN for those that are unknown or invalid."""
    terms: dict[str, float] = {}
    if isinstance(message, ControllerState):
        terms = dict(zip(message.names, message.values, strict=False))
    values = (terms.get(name, getattr(message, name, nan)) for name in FIELDS[names.PID_STATE])
    return tuple(value if abs(value) <= _GREATEST else nan for value in values)
