"""Subscribes to the topics of a recording over DDS, as they are discovered."""

from __future__ import annotations

import re
import threading
from typing import TYPE_CHECKING, Any

from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible

from barc_sim.errors import UserError
from barc_sim.ros.peers import of_participant
from barc_sim.ros.recording.failures import Failures
from barc_sim.ros.recording.polled import Taker, subscribe
from barc_sim.ros.recording.topic import RecordedTopic
from barc_sim.ros.topics import describe, message_class, overriding, request

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from rclpy.node import Node
    from rclpy.subscription import Subscription
    from rclpy.topic_endpoint_info import TopicEndpointInfo

    from barc_sim.bags.messages import MessageFields
    from barc_sim.bags.recording_settings import Recording

_ERROR = re.compile('ERROR: ([^;]*);')  # a reason of rmw for a QoS that does not match
_NAMELESS = '_NODE_NAME_UNKNOWN_'  #: of a node that rmw does not know yet


class TopicSubscriptions:
    """Subscribes to the topics of a recording, and takes the messages of all publishers.

    A topic gets one subscription for each QoS that its publishers offer, so that a publisher with a
    weak QoS does not weaken the others. A topic that other nodes subscribe to gets a subscription
    with their QoS before it has a publisher: a publisher may send one message and end before it is
    discovered.

    A topic with a QoS of the user's has one subscription, with that QoS.
    """

    is_unlimited = False  # the queues of DDS have a depth

    def __init__(self, node: Node, recording: Recording) -> None:
        self._node = node
        self._is_selected = recording.needs
        self._depth = recording.depth
        self._overrides = {
            name: _with_queue(overriding(policies, self._depth), self._depth)
            for name, policies in recording.qos_overrides.items()
        }
        self._failures = Failures(node.get_logger())

        self._turn = 0  # the place of the topic whose publishers are looked at without a sign
        self._impossible: set[str] = set()  # topics without a publisher that cannot be recorded

        self._taker = Taker()
        self._topics: dict[str, RecordedTopic] = {}
        self._closed = False
        self._lock = threading.Lock()  # of `_topics`, between discovery and the taking thread

    @property
    def left_out(self) -> Mapping[str, str]:
        """Why a topic cannot be recorded, by its name."""
        return self._failures.left_out

    def expect(self, name: str, type_name: str) -> None:
        """Subscribe, reliably, to a selected topic before it has a publisher or subscriptions."""
        if self._is_selected(name, [type_name]) and name not in self._topics:
            self._subscribe_early(name, message_class(type_name), QoSProfile(depth=self._depth))

    def discover(self) -> None:
        """Subscribe to each selected topic with a new publisher since the last call.

        Subscribe also to each topic with its first subscription. For a topic that cannot be
        recorded, warn once.
        """
        topics = self._node.get_topic_names_and_types()
        self._turn = (self._turn + 1) % max(1, len(topics))
        for place, (name, types) in enumerate(topics):
            if not self._is_selected(name, types) or self._failures.is_refused(name, types):
                continue
            # To look at each publisher takes long: without a sign of a new one, one topic a call.
            if place == self._turn or self._has_changed(name, types):
                self._look_at(name, types)

    def _has_changed(self, name: str, types: list[str]) -> bool:
        """Return whether a topic is new, or has other types or more or fewer publishers."""
        recorded = self._topics.get(name)
        if recorded is None or recorded.types != types:
            return True
        publishers: int = self._node.count_publishers(name)
        return recorded.publishers != publishers

    def _look_at(self, name: str, types: list[str]) -> None:
        """Subscribe to the publishers of a topic, or like its subscriptions."""
        recorded = self._topics.get(name)
        publishers = self._node.get_publishers_info_by_topic(name)
        if publishers:
            self._subscribe(name, publishers)
        elif recorded:
            recorded.publishers = 0
        elif name not in self._impossible and self._follow(name):
            self._impossible.add(name)  # its first publisher causes the warning

        if recorded:
            recorded.types = types
        self._failures.set_types(name, types)

    def _follow(self, name: str) -> Exception | None:
        """Subscribe to a topic with the QoS of its subscribers; return why it is impossible."""
        endpoints = self._node.get_subscriptions_info_by_topic(name)
        if not endpoints:
            return None
        try:
            message_type = message_class(self._type_of(endpoints))
            self._subscribe_early(name, message_type, request(endpoints, self._depth))
        except (RuntimeError, UserError) as error:  # of rcl: this process has another type
            return error
        return None

    def _type_of(self, endpoints: Sequence[TopicEndpointInfo]) -> str:
        """Return the topic's type in this participant, in which DDS allows one; else the first."""
        types = {each.topic_type for each in endpoints}
        ours = of_participant(self._node, endpoints) if len(types) > 1 else []
        first = (ours or endpoints)[0]
        return str(first.topic_type)

    def _subscribe_early(self, name: str, message_type: type[Any], qos: QoSProfile) -> None:
        """Subscribe to a topic that has no publisher yet."""
        qos = self._overrides.get(name, qos)
        subscription = subscribe(self._node, message_type, name, qos)
        endpoints = self._node.get_subscriptions_info_by_topic(subscription.topic_name)
        recorded = RecordedTopic(describe(name, endpoints), subscriptions=[subscription])
        with self._lock:
            self._topics[name] = recorded

    def _subscribe(self, name: str, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Subscribe to all publishers of a topic, except publishers of another type."""
        recorded = self._topics.get(name)
        type_name = recorded.topic.type if recorded else self._type_of(publishers)
        types = {publisher.topic_type for publisher in publishers}
        for other in types - {type_name}:
            self._failures.leave_out(f'{name} as {other}', f'its type is {type_name}')

        try:
            if type_name in types:
                of_type = [each for each in publishers if each.topic_type == type_name]
                recorded = self._add_subscriptions(name, recorded, of_type)
        except UserError as error:
            self._failures.leave_out(name, f'{type_name}: {error}')
            return
        except RuntimeError:  # of rcl: another node of this process has another type
            why = self._follow(name)
            if why:
                self._failures.leave_out(name, f'{type_name}: {why}')
            return

        # A publisher can be discovered before its node: its name comes with the next search.
        if recorded and all(each.node_name != _NAMELESS for each in publishers):
            recorded.publishers = len(publishers)

    def _add_subscriptions(
        self, name: str, recorded: RecordedTopic | None, publishers: Sequence[TopicEndpointInfo]
    ) -> RecordedTopic:
        """Return the topic with its subscriptions: for each QoS that its publishers offer."""
        if recorded is None:
            recorded = RecordedTopic(describe(name, publishers))
        elif not (recorded.topic.offered_qos or recorded.route):  # it has had no publisher
            recorded.topic = describe(name, publishers)
        self._failures.check_definition(recorded.topic)

        for qos in self._missing_profiles(name, recorded, publishers):
            subscription = subscribe(self._node, message_class(recorded.topic.type), name, qos)
            with self._lock:
                recorded.subscriptions.append(subscription)

        recorded.add_publishers(publishers)
        with self._lock:
            self._topics[name] = recorded
        return recorded

    def _missing_profiles(
        self, name: str, recorded: RecordedTopic, publishers: Sequence[TopicEndpointInfo]
    ) -> Iterator[QoSProfile]:
        """Yield the QoS of each subscription that the topic lacks."""
        override = self._overrides.get(name)
        if override:
            self._check_override(name, override, publishers)
            if not recorded.subscriptions:
                yield override
            return

        offered = {_strength(each) for each in publishers}
        missing = offered - {_strength(each) for each in recorded.subscriptions}
        for reliability, durability in sorted(missing):  # the strongest first
            yield QoSProfile(depth=self._depth, reliability=reliability, durability=durability)

    def _check_override(
        self, name: str, override: QoSProfile, publishers: Sequence[TopicEndpointInfo]
    ) -> None:
        """Warn of publishers whose messages a subscription with the user's QoS does not get."""
        for publisher in publishers:
            result, reasons = qos_check_compatible(publisher.qos_profile, override)
            if result == QoSCompatibility.ERROR and publisher.node_name != _NAMELESS:
                errors = ', '.join(_ERROR.findall(reasons))
                self._failures.leave_out(
                    f'{name} of {publisher.node_name}',
                    f'it does not match the quality of service that is set for the topic: {errors}',
                )

    def call_when_full(self, write: Callable[[], object]) -> None:
        """Do nothing: the messages wait in the queues of DDS, which never calls."""

    def take(self) -> list[MessageFields]:
        """Return the waiting messages, topic by topic; call it from one thread only."""
        messages: list[MessageFields] = []
        with self._lock:
            for recorded in self._topics.values():
                messages += recorded.take(self._taker, self._depth)
        return messages

    def lost(self) -> dict[str, dict[str, int]]:
        """Return the number of messages known to be lost, by topic and publishing node.

        A publisher that ended before its node was discovered is listed by its GID.
        """
        with self._lock:
            self._count_undelivered()
            return {name: recorded.lost() for name, recorded in self._topics.items()}

    def unknown(self) -> dict[str, str]:
        """Return why more messages of a topic may be lost, by topic."""
        with self._lock:
            reasons = {name: recorded.unknown() for name, recorded in self._topics.items()}
        return {name: reason for name, reason in reasons.items() if reason}

    def _count_undelivered(self) -> None:
        if not self._closed:
            for recorded in self._topics.values():
                recorded.count_undelivered()

    def close(self) -> None:
        """Destroy the subscriptions; `lost` and `unknown` stay available."""
        with self._lock:
            self._count_undelivered()
            self._closed = True
            for recorded in self._topics.values():
                for subscription in recorded.subscriptions:
                    self._node.destroy_subscription(subscription)
        self._taker.close()


def _with_queue(qos: QoSProfile, depth: int) -> QoSProfile:
    """Return the QoS with a queue of at least `depth`: this one is emptied ten times a second."""
    qos.depth = max(qos.depth, depth)
    return qos


def _strength(endpoint: TopicEndpointInfo | Subscription) -> tuple[Any, Any]:
    """Return reliability and durability of a publisher or subscription."""
    return endpoint.qos_profile.reliability, endpoint.qos_profile.durability
