"""The publishers of a playback: one for each topic, with the quality of service of the bags."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from rclpy.duration import Duration

from barc_sim.bags.messages import CDR
from barc_sim.bags.recording_settings import selected
from barc_sim.errors import UserError, escaped
from barc_sim.interfaces.topics import CLOCK
from barc_sim.ros.peers import others_here
from barc_sim.ros.topics import message_class, offer, overriding

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from barc_sim.bags.messages import BagMessage, Topic
    from barc_sim.bags.playback_settings import Playback
    from barc_sim.nodes.playback_bags import PlaybackBags
    from barc_sim.nodes.playback_clock import PlaybackClock

_MATCHING = 1.0  #: [s] without a new subscription after which matching counts as complete
_MAX_MATCHING = 5.0  #: [s]
_ACK_TIMEOUT = 3.0  #: [s] to wait until the last messages are acknowledged
_DEPTH = 1000  #: of the queue of a topic whose QoS the user sets without a depth


class PlaybackPublishers:
    """The publishers of the topics to play.

    A topic has one publisher, also if several bags have it: it reaches every subscription that one
    of the recorded publishers reached. A topic whose type is not installed is left out, with a
    warning.

    Parameters
    ----------
    node
        The node that publishes.
    bags
        The bags.
    playback
        Which topics to play, and with which QoS.

    Attributes
    ----------
    topics
        The identities of the topics' records.

    Raises
    ------
    UserError
        No topic can be played.
    """

    def __init__(self, node: Node, bags: PlaybackBags, playback: Playback) -> None:
        self._node = node
        self._bags = bags
        self._qos_overrides = playback.qos_overrides
        self._publishers: dict[int, Publisher] = {}  # by the identity of the topic's record

        names = selected(bags.topic_names, playback.topics, playback.exclude)
        if playback.clock and CLOCK in names:
            names.remove(CLOCK)
        for name in names:
            self._add_publisher(name)
        if not self._publishers:
            raise UserError(f'{bags.name} has no topic that can be played: give other --topics')
        self.topics = frozenset(self._publishers)

    def _add_publisher(self, name: str) -> None:
        """Add the publisher of a topic: of its first type that can be played."""
        played_type = ''
        for records in self._bags.records(name):
            record = records[0]
            try:
                publisher = self._publisher(records, played_type)
            except Exception as error:  # noqa: BLE001 (a bag can have any names and types)
                reason = str(error).partition('\n')[0]
                what = f'{name} as {record.type}' if played_type else name
                self._node.get_logger().warning(escaped(f'{what} is not played: {reason}'))
            else:
                played_type = record.type
                for each in records:
                    self._publishers[id(each)] = publisher

    def _publisher(self, records: Sequence[Topic], played_type: str) -> Publisher:
        record = records[0]
        if played_type:  # DDS accepts one type of a topic in a participant
            raise UserError(f'{played_type} is played')
        if record.message_encoding != CDR:
            raise UserError(f'its messages are {record.message_encoding!r}, and not {CDR!r}')
        if not record.type:
            raise UserError('the bag does not have its type')

        policies = self._qos_overrides.get(record.name)
        if policies is None:
            offered = [profile for each in records for profile in each.offered_qos]
            qos = offer(offered)
        else:
            qos = overriding(policies, _DEPTH)
        return self._node.create_publisher(message_class(record.type), record.name, qos)

    def publish(self, message: BagMessage) -> None:
        """Publish a message of one of `topics`, serialized as it is."""
        self._publishers[id(message.topic)].publish(message.data)

    def wait_for_subscriptions(self, clock: PlaybackClock) -> None:
        """Wait until present subscriptions have matched, or the `clock` is stopped.

        Subscriptions that match later would miss the first messages.
        """
        begin = time.monotonic()
        changed = begin
        is_alone = not others_here(self._node.context.get_domain_id())
        counts: list[int] = []

        now = begin
        while now < min(changed + _MATCHING, begin + _MAX_MATCHING) and not clock.is_stopped:
            before = counts
            counts = [each.get_subscription_count() for each in self._publishers.values()]
            has_found_others = is_alone or len(self._node.get_node_names()) > 1
            if counts != before or not has_found_others:
                changed = now
            time.sleep(0.02)
            now = time.monotonic()

    def wait_until_acknowledged(self) -> None:
        """Wait until the last messages have arrived, for some seconds at most."""
        end = time.monotonic() + _ACK_TIMEOUT
        for publisher in self._publishers.values():
            left = max(0.0, end - time.monotonic())
            publisher.wait_for_all_acked(Duration(seconds=left))
