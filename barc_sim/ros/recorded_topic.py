"""A topic that is recorded: its subscriptions, and what was lost of each publisher."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rclpy.qos import DurabilityPolicy

from barc_sim.bags.recording import Losses
from barc_sim.ros import offered_qos

if TYPE_CHECKING:
    from rclpy.subscription import Subscription
    from rclpy.topic_endpoint_info import TopicEndpointInfo

    from barc_sim.bags.metadata import Topic


@dataclass
class RecordedTopic:
    """A topic with its subscriptions, and what has arrived through them.

    Examples
    --------
    >>> from barc_sim.bags.messages import topic
    >>> ecu = RecordedTopic(topic('/ecu', 'barc_interfaces/msg/ECU'), names={b'a': '/relay'})
    >>> for number in (1, 2, 5):
    ...     ecu.losses.count(b'a', number)
    >>> ecu.lost()
    {'/relay': 2}
    """

    topic: Topic
    publishers: int = 0
    since: float = field(default_factory=time.monotonic)
    subscriptions: list[Subscription] = field(default_factory=list)
    #: By publisher, the index of the subscription that counts: the first one to get a message.
    route: dict[bytes, int] = field(default_factory=dict)
    losses: Losses = field(default_factory=Losses)
    names: dict[bytes, str] = field(default_factory=dict)  # of the publishers' nodes

    @property
    def begun(self) -> bool:
        """Whether it has had a publisher."""
        return bool(self.topic.offered_qos or self.route)

    def matches(self, publisher: TopicEndpointInfo) -> bool:
        """Return whether one of the subscriptions matches the publisher's QoS."""
        return any(
            offered_qos.matches(publisher, subscription.qos_profile)
            for subscription in self.subscriptions
        )

    @property
    def latched(self) -> bool:
        """Whether publishers keep messages for late subscriptions."""
        return any(
            subscription.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
            for subscription in self.subscriptions
        )

    def lost(self) -> dict[str, int] | None:
        """Return the number of lost messages, by the publisher's node; None where unknown."""
        if self.losses.unnumbered:
            return None
        by_node: dict[str, int] = {}
        for publisher, count in self.losses.by_publisher.items():
            node = self.names.get(publisher, publisher.hex())
            by_node[node] = by_node.get(node, 0) + count
        return by_node
