"""The QoS and description of topics, and polled subscriptions that record raw messages."""

from __future__ import annotations

import ctypes
import importlib
import threading
from collections import defaultdict
from contextlib import suppress
from ctypes import c_size_t, c_void_p
from dataclasses import dataclass, field
from enum import Enum
from math import inf
from struct import Struct
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import CallbackGroup
from rclpy.duration import Duration
from rclpy.event_handler import QoSSubscriptionEventType, SubscriptionEventCallbacks
from rclpy.qos import (
    DurabilityPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.topic_endpoint_info import TopicEndpointTypeEnum

from barc_sim.bags.messages import Topic
from barc_sim.bags.recording import Losses
from barc_sim.bags.schemas import schema
from barc_sim.errors import UserError, escaped
from barc_sim.ros.peers import of_participant

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from types import ModuleType

    from rclpy.node import Node
    from rclpy.subscription import Subscription
    from rclpy.topic_endpoint_info import TopicEndpointInfo

    from barc_sim.bags.messages import MessageFields
    from barc_sim.bags.recording import Recording


_DEPTH = 1000  #: of a queue, if the bag has no depth: DDS does not announce it to other processes
_MAX_DEPTH = 2**31 - 1
_INTERFACES = ('msg', 'srv', 'action')
_QOS = (
    *('history', 'depth', 'reliability', 'durability', 'deadline', 'lifespan', 'liveliness'),
    *('liveliness_lease_duration', 'avoid_ros_namespace_conventions'),
)
_NAMELESS = '_NODE_NAME_UNKNOWN_'  #: of a node that rmw does not know yet
_BEST = ('best_effort', ReliabilityPolicy.BEST_EFFORT.value)
_LATCHED = ('transient_local', DurabilityPolicy.TRANSIENT_LOCAL.value)


def message_class(type_name: str) -> type[Any]:
    """Return the class of a type such as `std_msgs/msg/String`."""
    package, *rest = type_name.split('/')
    kind: Any = None
    if len(rest) == 2 and rest[0] in _INTERFACES:  # noqa: PLR2004
        with suppress(AttributeError, ImportError, TypeError, ValueError):
            kind = _generated(importlib.import_module(f'{package}.{rest[0]}'), rest[1])
    if not hasattr(kind, 'get_fields_and_field_types'):  # a bag can name any class
        raise UserError(
            f'the type {type_name} is not installed here: source the workspace of {package}'
        )
    return kind  # type: ignore[no-any-return]


def _generated(package: ModuleType, name: str) -> Any:  # noqa: ANN401 (any attribute)
    """Return the class of a type, also of a part of an action, such as `Fibonacci_FeedbackMessage`.

    The package exports the action itself, but not all of its parts.
    """
    if hasattr(package, name):
        return getattr(package, name)
    whole = getattr(package, name.partition('_')[0])
    return getattr(importlib.import_module(whole.__module__), name)


def request(endpoints: Sequence[TopicEndpointInfo], depth: int) -> QoSProfile:
    """Return the strongest QoS that all publishers offer, as rosbag2 requests it.

    For subscriptions, return the QoS that receives every message that any of them receives.
    """
    offered = [each.qos_profile for each in endpoints]
    return _profile(
        depth,
        reliable=all(each.reliability == ReliabilityPolicy.RELIABLE for each in offered),
        latched=all(each.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in offered),
    )


def offer(recorded: Sequence[Mapping[str, Any]]) -> QoSProfile:
    """Return the QoS of the one publisher that replaces the recorded publishers.

    `recorded` has their QoS as rosbag2 writes it, in older bags with a number for each policy. The
    new publisher reaches every subscription that one of them reached, and keeps as many messages
    for late subscriptions. UserError: it is no QoS.
    """
    try:
        depth = max((int(each.get('depth', 0)) for each in recorded), default=0)
        return _profile(
            min(depth, _MAX_DEPTH) or _DEPTH,
            reliable=not recorded or any(each.get('reliability') not in _BEST for each in recorded),
            latched=any(each.get('durability') in _LATCHED for each in recorded),
        )
    except (AttributeError, TypeError, ValueError) as error:
        raise UserError(f'{[*recorded]!r} is not a quality of service: {error}') from None


def latch(recorded: Sequence[Mapping[str, Any]]) -> tuple[int, float] | None:
    """Return how many messages a latched topic's publishers hold, and for how long [ns].

    None: the topic is not latched. `recorded` is as for `offer`.
    """
    profiles = [each for each in recorded if each.get('durability') in _LATCHED]
    if not profiles:
        return None
    lifespans = [each.get('lifespan') for each in profiles]
    longest = max(map(_nanoseconds, lifespans))
    return offer(profiles).depth * len(profiles), longest


def _nanoseconds(duration: object) -> float:
    """Return a duration [ns] in rosbag2's terms; infinity if it is none."""
    try:
        return float(int(duration['sec']) * 10**9 + int(duration['nsec']))  # type: ignore[index]
    except (KeyError, OverflowError, TypeError, ValueError):
        return inf


def _profile(depth: int, *, reliable: bool, latched: bool) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def _strength(end: TopicEndpointInfo | Subscription) -> tuple[Any, Any]:
    """Return reliability and durability of a publisher or subscription."""
    return end.qos_profile.reliability, end.qos_profile.durability


def describe(name: str, endpoints: Sequence[TopicEndpointInfo]) -> Topic:
    """Return a bag's record of the topic, from its publishers or else its subscriptions."""
    type_name = endpoints[0].topic_type
    try:
        text, encoding = schema(type_name)
    except LookupError:  # not installed here, but perhaps where the bag is read
        text, encoding = '', ''
    return Topic(
        name=name,
        type=type_name,
        definition=text,
        schema_encoding=encoding,
        type_hash=str(endpoints[0].topic_type_hash),
        offered_qos=[
            {policy: _plain(getattr(each.qos_profile, policy)) for policy in _QOS}
            for each in endpoints
            if each.endpoint_type == TopicEndpointTypeEnum.PUBLISHER
        ],
    )


def _plain(value: Any) -> Any:  # noqa: ANN401 (a policy, a duration, a number)
    if isinstance(value, Duration):
        sec, nsec = divmod(value.nanoseconds, 10**9)
        return {'sec': sec, 'nsec': nsec}
    return value.name.lower() if isinstance(value, Enum) else value


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
    best_effort: set[bytes] = field(default_factory=set)  # publishers that send nothing again
    types: list[str] = field(default_factory=list)  # of all publishers and subscriptions
    undelivered: int = 0  #: number of messages that the middleware could not deliver

    def add_publishers(self, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Add the names and reliability of publishers."""
        for publisher in publishers:
            identity = bytes(publisher.endpoint_gid)
            self.names[identity] = publisher.node_name
            if publisher.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT:
                self.best_effort.add(identity)

    def lost(self) -> dict[str, int]:
        """Return the number of messages that are known to be lost, by the publisher's node."""
        by_node: dict[str, int] = {}
        for publisher, count in self.losses.by_publisher.items():
            node = self._node(publisher)
            by_node[node] = by_node.get(node, 0) + count
        gaps = sum(by_node.values())
        if self.undelivered > gaps:  # before a publisher's first message, or after its last one
            node = ' or '.join(sorted({*self.names.values()})) or 'an unknown node'
            by_node[node] = by_node.get(node, 0) + self.undelivered - gaps
        return by_node

    def unknown(self) -> str | None:
        """Return why more messages may be lost; None: no reason is known."""
        if self.losses.unnumbered:
            return 'the middleware does not number its messages'
        if silent := self.best_effort - self.route.keys():
            nodes = ', '.join(sorted({self._node(publisher) for publisher in silent}))
            return f'no message arrived from {nodes}, which sends with best effort'
        return None

    def _node(self, publisher: bytes) -> str:
        return self.names.get(publisher, publisher.hex())

    def count_undelivered(self) -> None:
        """Ask the middleware for the number of messages that it could not deliver.

        Not with several subscriptions: what one of them has lost, another one can have received.
        """
        if len(self.subscriptions) == 1:
            self.undelivered = undelivered(self.subscriptions[0])


class TopicSubscriptions:
    """Subscribes to the topics of a recording, and takes the messages of all publishers.

    A topic gets one subscription for each QoS that its publishers offer, so that a publisher with a
    weak QoS does not weaken the others. A topic that other nodes subscribe to gets a subscription
    with their QoS before it has a publisher: a publisher may send one message and end before it is
    discovered.
    """

    def __init__(self, node: Node, recording: Recording) -> None:
        self._node = node
        self._wants, self._depth = recording.needs, recording.depth
        self._taker = Taker()
        self._topics: dict[str, RecordedTopic] = {}
        self._lock = threading.Lock()  # of `_topics`
        self._closed = False
        self._undefined: set[str] = set()  # topics without a definition
        self.left_out: dict[str, str] = {}  #: why a topic cannot be recorded, by its name
        self._refused: dict[str, list[str]] = {}  # types of the topics that cannot be recorded
        self._turn = 0  # the place of the topic of which each publisher is looked at
        self._unexpected: set[str] = set()  # topics that cannot be recorded yet: no publisher

    def expect(self, name: str, message_type: type[Any]) -> None:
        """Subscribe, reliably, to a selected topic before it has a publisher or subscriptions."""
        if self._wants(name) and name not in self._topics:
            self._subscribe_early(name, message_type, QoSProfile(depth=self._depth))

    def discover(self) -> None:
        """Subscribe to each selected topic with a new publisher since the last call.

        Subscribe also to each topic with its first subscription. For a topic that cannot be
        recorded, warn once.
        """
        present = self._node.get_topic_names_and_types()
        self._turn = (self._turn + 1) % max(1, len(present))
        for turn, (name, types) in enumerate(present):
            recorded = self._topics.get(name)
            count = self._node.count_publishers(name)
            if self._refused.get(name) == types:
                continue
            # To look at each publisher takes long: without a sign of a new one, one topic a call.
            is_known = recorded and recorded.publishers == count and recorded.types == types
            if is_known and turn != self._turn:
                continue
            if self._wants(name):
                if publishers := self._node.get_publishers_info_by_topic(name):
                    self._subscribe(name, publishers)
                elif recorded:
                    recorded.publishers = 0
                elif name not in self._unexpected and self._follow(name):
                    self._unexpected.add(name)  # its first publisher causes the warning
            if recorded:
                recorded.types = types
            if name in self.left_out:
                self._refused[name] = types

    def _follow(self, name: str) -> Exception | None:
        """Subscribe to a topic with the QoS of its subscribers; return why it is impossible."""
        try:
            if endpoints := self._node.get_subscriptions_info_by_topic(name):
                kind = message_class(self._type_of(endpoints))
                self._subscribe_early(name, kind, request(endpoints, self._depth))
        except (RuntimeError, UserError) as error:  # of rcl: this process has another type
            return error
        return None

    def _type_of(self, endpoints: Sequence[TopicEndpointInfo]) -> str:
        """Return the topic's type in this participant, in which DDS allows one; else the first."""
        several = len({each.topic_type for each in endpoints}) > 1
        ours = of_participant(self._node, endpoints) if several else []
        type_name: str = (*ours, *endpoints)[0].topic_type
        return type_name

    def _subscribe_early(self, name: str, message_type: type[Any], qos: QoSProfile) -> None:
        """Subscribe to a topic that has no publisher yet."""
        subscription = self._create(name, message_type, qos)
        endpoints = self._node.get_subscriptions_info_by_topic(subscription.topic_name)
        recorded = RecordedTopic(describe(name, endpoints), subscriptions=[subscription])
        with self._lock:
            self._topics[name] = recorded

    def _subscribe(self, name: str, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Subscribe to all publishers of a topic, except publishers of another type."""
        recorded = self._topics.get(name)
        types = {publisher.topic_type for publisher in publishers}
        type_name = recorded.topic.type if recorded else self._type_of(publishers)
        for other in types - {type_name}:
            self._leave_out(f'{name} as {other}', f'its type is {type_name}')
        try:
            if of_type := [each for each in publishers if each.topic_type == type_name]:
                recorded = self._add_subscriptions(name, recorded, of_type)
        except UserError as error:
            self._leave_out(name, f'{type_name}: {error}')
        except RuntimeError:  # of rcl: another node of this process has another type
            if why := self._follow(name):
                self._leave_out(name, f'{type_name}: {why}')
        else:
            # A publisher can be discovered before its node: its name comes with the next search.
            if recorded and all(each.node_name != _NAMELESS for each in publishers):
                recorded.publishers = len(publishers)

    def _leave_out(self, what: str, why: str) -> None:
        """Warn once that something is not recorded, and keep the reason."""
        if what not in self.left_out:
            self.left_out[what] = why
            self._node.get_logger().warning(escaped(f'{what} is not recorded: {why}'))

    def _add_subscriptions(
        self, name: str, recorded: RecordedTopic | None, publishers: Sequence[TopicEndpointInfo]
    ) -> RecordedTopic:
        """Return the topic with a subscription for each QoS that its publishers offer."""
        recorded = recorded or RecordedTopic(describe(name, publishers))
        if not (recorded.topic.offered_qos or recorded.route):  # it has had no publisher
            recorded.topic = describe(name, publishers)
        self._check_definition(recorded.topic)
        missing = {*map(_strength, publishers)} - {*map(_strength, recorded.subscriptions)}
        for reliability, durability in sorted(missing):  # the strongest first
            qos = QoSProfile(depth=self._depth, reliability=reliability, durability=durability)
            subscription = self._create(name, message_class(recorded.topic.type), qos)
            with self._lock:
                recorded.subscriptions.append(subscription)
        recorded.add_publishers(publishers)
        with self._lock:
            self._topics[name] = recorded
        return recorded

    def _check_definition(self, topic: Topic) -> None:
        """Warn once of a topic whose definition the bag does not have."""
        if topic.definition or topic.name in self._undefined:
            return
        self._undefined.add(topic.name)
        package = topic.type.partition('/')[0]
        self._node.get_logger().warning(
            f'{topic.name} is recorded without the definition of {topic.type}, which is not '
            f'installed here: only a reader with this type can decode it; source the workspace of '
            f'{package}'
        )

    def _create(self, name: str, message_type: type[Any], qos: QoSProfile) -> Subscription:
        return self._node.create_subscription(
            message_type,
            name,
            lambda _: None,
            qos,
            callback_group=PolledCallbackGroup(),
            event_callbacks=SubscriptionEventCallbacks(
                message_lost=lambda _: None,  # for `undelivered`
                use_default_callbacks=False,
            ),
            raw=True,
        )

    def take(self) -> list[MessageFields]:
        """Return the waiting messages, topic by topic; call it from one thread only."""
        with self._lock:
            return [message for topic in self._topics.values() for message in self._take(topic)]

    def _take(self, recorded: RecordedTopic) -> list[MessageFields]:
        topic, route = recorded.topic, recorded.route
        messages: list[MessageFields] = []
        for index, subscription in enumerate(recorded.subscriptions):
            numbers: defaultdict[bytes, list[int]] = defaultdict(list)
            taken = self._taker.take(subscription, self._depth)
            for data, published, received, number, publisher in taken:
                if route.setdefault(publisher, index) == index:
                    numbers[publisher].append(number)
                    messages.append((topic, data, received, published, number))
            for publisher, counted in numbers.items():
                recorded.losses.count(publisher, counted)
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


def undelivered(subscription: Subscription) -> int:
    """Return the number of messages that the middleware could not deliver, as it counts them."""
    for handler in subscription.event_handlers:
        if handler.event_type == QoSSubscriptionEventType.RCL_SUBSCRIPTION_MESSAGE_LOST:
            # `handler.take_data` takes only what an executor has waited for.
            event = handler._EventHandler__event  # noqa: SLF001
            with event:
                return int(event.take_event().total_count)
    return 0


class PolledCallbackGroup(CallbackGroup):
    """Keeps its subscriptions out of every executor's wait set.

    A wake-up for each message would cost 4 % of a core at 50 Hz with 7 topics; polling all of them
    every 50 ms costs about 1 %, and nothing runs between a state and the command that answers it.
    DDS stamps the time of reception, so a late poll loses nothing.
    """

    polled = True  #: QuickExecutor ignores them, too

    def can_execute(self, entity: object) -> bool:  # noqa: ARG002 (rclpy's)
        """Return False: no executor calls back for its subscriptions."""
        return False


class _Allocator(ctypes.Structure):  # rcutils_allocator_t: four functions and their state
    _fields_ = (('pointers', c_void_p * 5),)


class _Array(ctypes.Structure):  # rcutils_uint8_array_t
    _fields_ = (
        ('buffer', c_void_p),
        ('length', c_size_t),
        ('capacity', c_size_t),
        ('allocator', _Allocator),
    )


#: Fields of rmw_message_info_t: times of publication and reception, number, and the publisher's
#: GID, which rclpy's own take omits.
_INFO = Struct('=qqQ16x16s')
_MAX_INFO = 256  # bytes: another rmw may write more than Fast DDS
_NO_MESSAGE = 401  # RCL_RET_SUBSCRIPTION_TAKE_FAILED


class Taker:
    """Takes messages through one buffer, which rcl enlarges; for one thread at a time."""

    def __init__(self) -> None:
        rcutils = ctypes.PyDLL('librcutils.so')
        rcutils.rcutils_get_default_allocator.restype = _Allocator
        self._array = _Array(allocator=rcutils.rcutils_get_default_allocator())
        self._info = ctypes.create_string_buffer(_MAX_INFO)
        # PyDLL keeps the interpreter's lock: to release it for 2 us would cost more than that.
        self._take = ctypes.PyDLL('librcl.so').rcl_take_serialized_message
        self._free = rcutils.rcutils_uint8_array_fini

    def take(
        self, subscription: Subscription, maximum: int
    ) -> list[tuple[bytes, int, int, int, bytes]]:
        """Return at most `maximum` of the messages that wait in `subscription`.

        Each has its CDR, the times of publication and reception [ns], and the publisher's number
        for it and GID. RuntimeError: rcl has failed.
        """
        take, array, info, unpack = self._take, self._array, self._info, _INFO.unpack_from
        arguments = ctypes.byref(array), ctypes.byref(info), None
        buffer = (ctypes.c_char * 0)()
        taken: list[Any] = []
        result = 0
        with subscription.handle:
            pointer = c_void_p(subscription.handle.pointer)
            while len(taken) < maximum and (result := take(pointer, *arguments)) == 0:
                if array.capacity != len(buffer):
                    buffer = (ctypes.c_char * array.capacity).from_address(array.buffer)
                taken.append((buffer[: array.length], *unpack(info)))
        if result not in (0, _NO_MESSAGE):
            raise RuntimeError(
                f'rcl_take_serialized_message returned {result} on {subscription.topic_name}'
            )
        return taken

    def close(self) -> None:
        """Free the buffer."""
        self._free(ctypes.byref(self._array))
