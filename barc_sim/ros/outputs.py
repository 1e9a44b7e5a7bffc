"""Publishes messages for each state of a node, those alone that have subscriptions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from barc_sim.interfaces import qos
from barc_sim.interfaces.stamps import to_nanoseconds

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from builtin_interfaces.msg import Time
    from rclpy.node import Node
    from rclpy.publisher import Publisher

_RECOUNT_NS = 500_000_000


class Subscribed:
    """Finds the publishers of a node that have subscriptions: others need no message.

    To count the subscriptions at each state would take a twentieth of a step in lock-step.
    """

    def __init__(self, node: Node) -> None:
        """Count the subscriptions to the publishers of `node`."""
        self._node = node
        self._window = -1  # the number of the latest 0.5 s
        self._publishers: set[Publisher] = set()

    def at(self, stamp_ns: int) -> set[Publisher]:
        """Return the publishers with subscriptions, counted once per 0.5 s of the stamps."""
        window = stamp_ns // _RECOUNT_NS
        if window != self._window:
            self._window = window
            self._publishers = {p for p in self._node.publishers if p.get_subscription_count()}
        return self._publishers


@dataclass
class _Output:
    """A message of a node, with its publisher."""

    publisher: Publisher
    message: Any
    fields: Callable[[], Mapping[str, Any]]
    every: int
    states: int = 0  #: states since the first subscription

    def publish(self, stamp: Time) -> None:
        """Publish the message of the state with this stamp, unless it is left out."""
        if self.states % self.every == 0:
            self.message.header.stamp = stamp
            for name, value in self.fields().items():
                setattr(self.message, name, value)
            self.publisher.publish(self.message)
        self.states += 1


class Outputs:
    """Publishes messages for each state; a message without a subscription is not made."""

    def __init__(self, node: Node) -> None:
        """Begin without messages."""
        self._node = node
        self._subscribed = Subscribed(node)
        self._outputs: list[_Output] = []

    def add(
        self,
        topic: str,
        message: Any,  # noqa: ANN401 (of any type)
        fields: Callable[[], Mapping[str, Any]],
        every: int = 1,
    ) -> None:
        """Publish `message` from now on, with what `fields` returns, for one state in `every`."""
        publisher = self._node.create_publisher(type(message), topic, qos.DEFAULT)
        self._outputs.append(_Output(publisher, message, fields, every))

    def publish(self, stamp: Time) -> None:
        """Publish the messages of the state with this stamp."""
        subscribed = self._subscribed.at(to_nanoseconds(stamp))
        for output in self._outputs:
            if output.publisher in subscribed:
                output.publish(stamp)
