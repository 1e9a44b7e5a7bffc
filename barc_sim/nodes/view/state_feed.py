"""Polls the topics of a run and joins their messages to the rows of the page."""

from __future__ import annotations

from math import nan
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from barc_interfaces.msg import ECU, ControllerState, Environment, EZDynBkMdl, PidState, ZDynBkMdl

from barc_sim.page.feed import Feed, controller_values, is_valid
from barc_sim.page.rows import FIELDS, STATE_FIELDS
from barc_sim.ros import names
from barc_sim.ros.conversions import to_nanoseconds
from barc_sim.ros.executor import PolledCallbackGroup
from barc_sim.ros.polled import polled, take

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

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


class StateFeed(Feed):
    """The states of a run with their other messages, from the topics."""

    def __init__(self, node: Node) -> None:
        """Subscribe with `node`."""
        super().__init__()
        group = PolledCallbackGroup()
        self._state_subscription = polled(node, ZDynBkMdl, names.STATE, _DEPTH, group)
        self._subscriptions = {
            topic: polled(node, kind, topic, _DEPTH, group) for topic, kind in _TYPES.items()
        }

    def _others(self) -> dict[str, list[Sample]]:
        others: dict[str, list[Sample]] = {topic: [] for topic in FIELDS}
        for topic, subscription in self._subscriptions.items():
            of_controller = topic in _OF_CONTROLLER
            samples = others[names.PID_STATE if of_controller else topic]
            for message, _ in take(subscription, _DEPTH):
                values = _controller_values(message) if of_controller else _VALUES[topic](message)
                if of_controller or is_valid(values):
                    samples.append((to_nanoseconds(message.header.stamp), values))
        return others

    def _states(self) -> list[tuple[int, Sample]]:
        return [
            (
                info['received_timestamp'],
                (to_nanoseconds(message.header.stamp), _STATE_VALUES(message)),
            )
            for message, info in take(self._state_subscription, _DEPTH)
        ]


def _controller_values(message: PidState | ControllerState) -> tuple[float, ...]:
    terms: dict[str, float] = {}
    if isinstance(message, ControllerState):
        terms = dict(zip(message.names, message.values, strict=False))
    return controller_values(lambda name: terms.get(name, getattr(message, name, nan)))
