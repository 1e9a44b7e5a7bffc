"""The class, the QoS and the description of a topic's messages."""

from __future__ import annotations

import importlib
from contextlib import suppress
from enum import Enum
from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.topic_endpoint_info import TopicEndpointTypeEnum

from barc_sim.bags.messages import Topic
from barc_sim.bags.schemas import schema
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from types import ModuleType

    from rclpy.topic_endpoint_info import TopicEndpointInfo

_DEPTH = 1000  #: of a queue, if the bag has no depth: DDS does not announce it to other processes
_MAX_DEPTH = 2**31 - 1
_INTERFACES = ('msg', 'srv', 'action')
_QOS = (
    'history',
    'depth',
    'reliability',
    'durability',
    'deadline',
    'lifespan',
    'liveliness',
    'liveliness_lease_duration',
    'avoid_ros_namespace_conventions',
)
_CHOICES = {
    'history': HistoryPolicy,
    'reliability': ReliabilityPolicy,
    'durability': DurabilityPolicy,
    'liveliness': LivelinessPolicy,
}
_DURATIONS = ('deadline', 'lifespan', 'liveliness_lease_duration')
_BEST = ('best_effort', ReliabilityPolicy.BEST_EFFORT.value)
_LATCHED = ('transient_local', DurabilityPolicy.TRANSIENT_LOCAL.value)


def message_class(type_name: str) -> type[Any]:
    """Return the class of a type such as `std_msgs/msg/String`."""
    package, _, rest = type_name.partition('/')
    interface, _, name = rest.partition('/')
    kind: Any = None
    if interface in _INTERFACES:
        with suppress(AttributeError, ImportError, TypeError, ValueError):
            kind = _generated(importlib.import_module(f'{package}.{interface}'), name)
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


def overriding(policies: Mapping[str, Any], depth: int) -> QoSProfile:
    """Return the QoS of a topic that a user has set; a policy without a value has ROS's default.

    Parameters
    ----------
    policies
        The values of `read_qos_overrides` for this topic.
    depth
        The length of the queue, if the user has set none or 0.
    """
    values: dict[str, Any] = {}
    for policy, value in policies.items():
        if policy in _CHOICES:
            values[policy] = _CHOICES[policy][value.upper()]
        elif policy in _DURATIONS:
            values[policy] = Duration(seconds=value['sec'], nanoseconds=value['nsec'])
        else:
            values[policy] = value
    values['depth'] = values.get('depth') or depth
    return QoSProfile(**values)


class Latch(NamedTuple):
    """What the publishers of a latched topic hold for late subscriptions."""

    depth: int  #: messages
    lifespan: float  #: [ns]; may be infinite


def latch(recorded: Sequence[Mapping[str, Any]]) -> Latch | None:
    """Return what a topic's publishers hold; None: the topic is not latched.

    `recorded` is as for `offer`.
    """
    profiles = [each for each in recorded if each.get('durability') in _LATCHED]
    if not profiles:
        return None
    depth = offer(profiles).depth * len(profiles)
    lifespan = max(_nanoseconds(each.get('lifespan')) for each in profiles)
    return Latch(depth, lifespan)


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


def describe(name: str, endpoints: Sequence[TopicEndpointInfo]) -> Topic:
    """Return a bag's record of the topic, from its publishers or else its subscriptions."""
    type_name = endpoints[0].topic_type
    try:
        text, encoding = schema(type_name)
    except LookupError:  # not installed here, but perhaps where the bag is read
        text = ''
        encoding = ''
    publishers = [
        each for each in endpoints if each.endpoint_type == TopicEndpointTypeEnum.PUBLISHER
    ]
    return Topic(
        name=name,
        type=type_name,
        definition=text,
        schema_encoding=encoding,
        type_hash=str(endpoints[0].topic_type_hash),
        offered_qos=[_policies(each.qos_profile) for each in publishers],
    )


def _policies(qos: QoSProfile) -> dict[str, Any]:
    """Return the policies of a QoS in rosbag2's terms."""
    return {policy: _plain(getattr(qos, policy)) for policy in _QOS}


def _plain(value: Any) -> Any:  # noqa: ANN401 (a policy, a duration, a number)
    if isinstance(value, Duration):
        sec, nsec = divmod(value.nanoseconds, 10**9)
        return {'sec': sec, 'nsec': nsec}
    return value.name.lower() if isinstance(value, Enum) else value
