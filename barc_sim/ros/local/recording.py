"""The subscriptions of a recorder without ROS."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

from barc_sim.bags.messages import topic
from barc_sim.ros.local.entities import Subscription
from barc_sim.ros.local.messages import message_type
from barc_sim.ros.local.qos import LATCHED

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from barc_sim.bags.messages import MessageFields
    from barc_sim.bags.recording_settings import Recording
    from barc_sim.ros.local.node import Node


class _RecordedSubscription(Subscription):
    """Stores serialized messages in a queue that it shares with the other topics."""

    raw = True

    def __init__(
        self, node: Node, name: str, type_name: str, store: Callable[[MessageFields], None]
    ) -> None:
        super().__init__(node, name, message_type(type_name), LATCHED)
        self._topic = topic(name, type_name)
        self._store = store

    def offer(self, arrival: Any, number: int = 0) -> None:
        """Store a message; the publisher's thread calls this, without an executor."""
        now = self.node.context.date()
        self._store((self._topic, arrival, now, now, number))


class LocalSubscriptions:
    """Subscribes to the selected topics; `take` returns their messages, serialized."""

    is_unlimited = True

    def __init__(self, node: Node, recording: Recording) -> None:
        self._node = node
        self._is_selected = recording.needs
        self._depth = recording.depth
        self._subscriptions: dict[str, Subscription] = {}
        self._messages: deque[MessageFields] = deque()
        self._write: Callable[[], object] | None = None
        self.left_out: Mapping[str, str] = {}  #: topics that cannot be recorded: none

    def expect(self, name: str, type_name: str) -> None:
        """Do nothing: a new publisher is discovered at once."""

    def discover(self) -> None:
        """Subscribe to each selected topic with a new publisher since the last call."""
        for name, types in self._node.get_topic_names_and_types():
            is_new = name not in self._subscriptions and self._is_selected(name, types)
            if is_new and self._node.get_publishers_info_by_topic(name):
                subscription = _RecordedSubscription(self._node, name, types[0], self._store)
                self._subscriptions[name] = self._node.connect(subscription)

    def call_when_full(self, write: Callable[[], object]) -> None:
        """Call `write` in the publisher's thread from now on when many messages wait."""
        self._write = write

    def _store(self, message: MessageFields) -> None:
        self._messages.append(message)
        if self._write and len(self._messages) > self._depth:
            self._write()

    def take(self) -> list[MessageFields]:
        """Return the messages since the last call; for one thread at a time."""
        return [self._messages.popleft() for _ in range(len(self._messages))]

    def lost(self) -> dict[str, dict[str, int]]:
        """Return the number of lost messages by topic: none."""
        return {name: {} for name in self._subscriptions}

    def unknown(self) -> dict[str, str]:
        """Return why more messages of a topic may be lost, by topic: none may."""
        return {}

    def close(self) -> None:
        """Destroy the subscriptions."""
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions.clear()
