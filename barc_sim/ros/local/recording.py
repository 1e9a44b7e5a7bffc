"""What nodes publish in this process, for a recorder: `ros/topic_subscriptions` without DDS."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

from barc_sim.bags.messages import Message, topic
from barc_sim.ros.local.context import QoSProfile, ReliabilityPolicy
from barc_sim.ros.local.messages import message_type, serialize_message, store
from barc_sim.ros.local.node import Subscription

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from barc_sim.ros.local.node import Node


class LocalSubscriptions:
    """Subscribes to the wanted topics; `take` returns their messages, serialized.

    Attributes
    ----------
    unknown
        No topic: all can be recorded.
    """

    expects_latched = False

    def __init__(self, node: Node, wants: Callable[[str], bool], depth: int) -> None:
        self._node, self._wants, self._depth = node, wants, depth
        self._subscriptions: dict[str, _Tap] = {}
        self._messages: deque[Message] = deque()
        self.unknown: Mapping[str, str] = {}

    def expect(self, *_: object) -> None:
        """Do nothing: a publisher is found as soon as it is there."""

    def discover(self) -> Iterator[Any]:
        """Subscribe to each wanted topic that has got a publisher since the last call."""
        for name, (kind, *_) in self._node.get_topic_names_and_types():
            wanted = name not in self._subscriptions and self._wants(name)
            if wanted and self._node.get_publishers_info_by_topic(name):
                self._subscriptions[name] = _Tap(self._node, name, kind, self._keep)
        yield from ()

    def _keep(self, message: Message) -> None:
        self._messages.append(message)
        if len(self._messages) > self._depth:
            self.on_full()

    def on_full(self) -> None:
        """Do nothing; a recorder replaces it to write what waits."""

    def take(self) -> list[Message]:
        """Return the messages since the last call, for one thread at a time."""
        return [self._messages.popleft() for _ in range(len(self._messages))]

    def lost(self) -> dict[str, dict[str, int] | None]:
        """Return the number of lost messages by topic: none."""
        return {name: {} for name in self._subscriptions}

    def close(self) -> None:
        """Destroy the subscriptions."""
        while self._subscriptions:
            self._node.destroy_subscription(self._subscriptions.popitem()[1])


class _Tap(Subscription):
    """Keeps each message when it is published, without an executor."""

    def __init__(self, node: Node, name: str, kind: str, keep: Callable[[Message], object]) -> None:
        qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        super().__init__(keep, True, node, name, message_type(kind), qos)
        self._topic = topic(name, kind, store())
        node.subscriptions.append(self)
        for publisher in node.context.all('publishers', name):
            publisher.match()
            for message, number in [*publisher.queue]:
                self.receive(message, number)

    def receive(self, msg: Any, number: int) -> None:
        now = self.node.context.world.date()
        self.callback(Message(self._topic, serialize_message(msg), now, now, number))
