"""A recorded topic: its subscriptions, the route of each publisher, and the lost messages."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rclpy.qos import ReliabilityPolicy

from barc_sim.bags.losses import Losses
from barc_sim.ros.recording.polled import undelivered

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rclpy.subscription import Subscription
    from rclpy.topic_endpoint_info import TopicEndpointInfo

    from barc_sim.bags.messages import MessageFields, Topic
    from barc_sim.ros.recording.polled import Taker


@dataclass
class RecordedTopic:
    """A topic with its subscriptions, and the losses and nodes of its publishers."""

    topic: Topic
    publishers: int = 0
    subscriptions: list[Subscription] = field(default_factory=list)
    #: The index of the subscription to record, by publisher: the first one that got a message.
    route: dict[bytes, int] = field(default_factory=dict)
    losses: Losses = field(default_factory=Losses)
    names: dict[bytes, str] = field(default_factory=dict)  # of the publishers' nodes
    best_effort: set[bytes] = field(default_factory=set)  # publishers: nothing is sent again
    types: list[str] = field(default_factory=list)  # of all publishers and subscriptions
    undelivered: int = 0  #: number of messages that the middleware could not deliver

    def add_publishers(self, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Add the names and reliability of publishers, after their subscriptions."""
        is_weak = all(_is_best_effort(subscription) for subscription in self.subscriptions)
        for publisher in publishers:
            identity = bytes(publisher.endpoint_gid)
            self.names[identity] = publisher.node_name
            if is_weak or _is_best_effort(publisher):
                self.best_effort.add(identity)

    def take(self, taker: Taker, maximum: int) -> list[MessageFields]:
        """Return the waiting messages, each once; at most `maximum` of each subscription."""
        topic = self.topic
        route = self.route
        messages: list[MessageFields] = []

        for index, subscription in enumerate(self.subscriptions):
            numbers: defaultdict[bytes, list[int]] = defaultdict(list)
            taken = taker.take(subscription, maximum)
            # The taker returns the fields in the order of rmw; a bag has the reception first.
            for data, published, received, number, publisher in taken:
                if route.setdefault(publisher, index) == index:
                    numbers[publisher].append(number)
                    messages.append((topic, data, received, published, number))
            for publisher, counted in numbers.items():
                self.losses.count(publisher, counted)
        return messages

    def count_undelivered(self) -> None:
        """Ask the middleware for the number of messages that it could not deliver.

        Not with several subscriptions: what one of them has lost, another one can have received.
        """
        if len(self.subscriptions) == 1:
            self.undelivered = undelivered(self.subscriptions[0])

    def lost(self) -> dict[str, int]:
        """Return the number of messages that are known to be lost, by the publisher's node."""
        by_node: Counter[str] = Counter()
        for publisher, count in self.losses.by_publisher.items():
            by_node[self._node(publisher)] += count

        # The middleware also counts those before a publisher's first message or after its last.
        gaps = sum(by_node.values())
        if self.undelivered > gaps:
            nodes = sorted({*self.names.values()})
            by_node[' or '.join(nodes) or 'an unknown node'] += self.undelivered - gaps
        return dict(by_node)

    def unknown(self) -> str | None:
        """Return why more messages may be lost; None: no reason is known."""
        if self.losses.unnumbered:
            return 'the middleware does not number its messages'
        silent = self.best_effort - self.route.keys()
        if silent:
            nodes = ', '.join(sorted({self._node(publisher) for publisher in silent}))
            return f'no message arrived from {nodes}, which sends with best effort'
        return None

    def _node(self, publisher: bytes) -> str:
        return self.names.get(publisher, publisher.hex())


def _is_best_effort(endpoint: TopicEndpointInfo | Subscription) -> bool:
    return bool(endpoint.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT)
