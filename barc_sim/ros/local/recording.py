"""What nodes publish in this process, for a recorder: `ros/topic_subscriptions` without DDS."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

from barc_sim.bags.messages import topic
from barc_sim.ros.local.context import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from barc_sim.ros.local.messages import message_type, store
from barc_sim.ros.local.node import Subscription

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from barc_sim.bags.messages import MessageFields
    from barc_sim.ros.local.node import Node

#: Of a subscription that matches every publisher.
_ANY = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.BEST_AVAILABLE,
)


class LocalSubscriptions:
    """Subscribes to the wanted topics; `take` returns their messages, serialized.

    A message is serialized and kept where it is published, without an executor.

    Attributes
    ----------
    unknown
        No topic: all can be recorded.
    """

    expects_latched = False

    def __init__(self, node: Node, wants: Callable[[str, Sequence[str]], bool], depth: int) -> None:
        self._node, self._wants, self._depth = node, wants, depth
        self._subscriptions: dict[str, Subscription] = {}
        self._messages: deque[MessageFields] = deque()
        self.unknown: Mapping[str, str] = {}

    def expect(self, *_: object) -> None:
        """Do nothing: a publisher is found as soon as it is there."""

    def discover(self) -> Iterator[Any]:
        """Subscribe to each wanted topic that has got a publisher since the last call."""
        for name, (kind, *_) in self._node.get_topic_names_and_types():
            wanted = name not in self._subscriptions and self._wants(name, (kind,))
            if wanted and self._node.get_publishers_info_by_topic(name):
                made = Subscription(self._node, name, message_type(kind), _ANY)
                made.receive = self._receiver(name, kind)  # type: ignore[assignment,method-assign]
                self._subscriptions[name] = self._node.connect(made)
        yield from ()

    def _receiver(self, name: str, kind: str) -> Callable[[Any, int], None]:
        """Return what keeps a message of a topic."""
        described, keep = topic(name, kind, store()), self._messages.append
        messages, depth, date = self._messages, self._depth, self._node.context.date

        def receive(msg: Any, number: int) -> None:
            now = date()
            keep((described, msg.__serialize__(), now, now, number))
            if len(messages) > depth:
                self.on_full()

        return receive

    def on_full(self) -> None:
        """Do nothing; a recorder replaces it to write what waits."""

    def take(self) -> list[MessageFields]:
        """Return the messages since the last call, for one thread at a time."""
        return [self._messages.popleft() for _ in range(len(self._messages))]

    def lost(self) -> dict[str, dict[str, int] | None]:
        """Return the number of lost messages by topic: none."""
        return {name: {} for name in self._subscriptions}

    def close(self) -> None:
        """Destroy the subscriptions."""
        while self._subscriptions:
            self._node.destroy_subscription(self._subscriptions.popitem()[1])
