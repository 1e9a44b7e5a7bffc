"""A topic as its publishers offer it: the class and definition of its messages, and the QoS."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.topic_endpoint_info import TopicEndpointTypeEnum

from barc_sim.bags.messages import definition
from barc_sim.bags.recording import Topic
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from rclpy.topic_endpoint_info import TopicEndpointInfo

_DEPTH = 1000  #: of a queue where none is recorded, as DDS tells no one else
_POLICIES: Mapping[str, Any] = {
    'history': HistoryPolicy,
    'reliability': ReliabilityPolicy,
    'durability': DurabilityPolicy,
    'liveliness': LivelinessPolicy,
}


def message_class(type_name: str) -> type[Any]:
    """Return the class of a type such as `std_msgs/msg/String`."""
    package, module, base = type_name.split('/')
    try:
        return getattr(importlib.import_module(f'{package}.{module}'), base)  # type: ignore[no-any-return]
    except (ImportError, AttributeError):
        raise UserError(
            f'the type {type_name} is not installed here: source the workspace of {package}'
        ) from None


def request(ends: Sequence[TopicEndpointInfo], depth: int) -> QoSProfile:
    """Return the strongest QoS that all publishers offer, as rosbag2 requests it.

    Of subscriptions, the QoS that gets every message that one of them gets.
    """
    return _joined([end.qos_profile for end in ends], depth, all)


def offer(recorded: Sequence[Mapping[str, Any]]) -> QoSProfile:
    """Return the QoS of a publisher in place of the recorded ones, in rosbag2's terms.

    Where these differ, it reaches every subscription that one of them reached.
    """
    profiles = [profile(each) for each in recorded] or [QoSProfile(depth=_DEPTH)]
    if all(each == profiles[0] for each in profiles):
        return profiles[0]
    return _joined(profiles, _DEPTH, any)


def _joined(
    profiles: Sequence[QoSProfile], depth: int, are: Callable[[Iterable[bool]], bool]
) -> QoSProfile:
    """Return a QoS that is reliable, or latched, if all or any of the profiles `are`."""
    reliable = are(each.reliability == ReliabilityPolicy.RELIABLE for each in profiles)
    latched = are(each.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in profiles)
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def profile(values: Mapping[str, Any]) -> QoSProfile:
    """Return a QoS in rosbag2's terms, of which any may be absent; UserError: it is none."""
    made = QoSProfile(depth=_DEPTH)
    try:
        for name, value in values.items():
            if policies := _POLICIES.get(name):  # by number in older bags
                member = policies(value) if isinstance(value, int) else policies[value.upper()]
                if member.name != 'UNKNOWN':
                    setattr(made, name, member)
            elif name == 'depth':
                made.depth = value or _DEPTH
            elif isinstance(value, dict):
                setattr(made, name, Duration(seconds=value['sec'], nanoseconds=value['nsec']))
            else:
                made.avoid_ros_namespace_conventions = bool(value)
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise UserError(
            f'{dict(values)!r} is no quality of service ({error!r}): write it as rosbag2 does, as '
            'in {reliability: best_effort, depth: 10}'
        ) from None
    return made


def matches(publisher: TopicEndpointInfo, requested: QoSProfile) -> bool:
    """Return whether a subscription that requests this QoS gets the publisher's messages."""
    compatibility, _ = qos_check_compatible(publisher.qos_profile, requested)
    return bool(compatibility != QoSCompatibility.ERROR)


def describe(name: str, ends: Sequence[TopicEndpointInfo]) -> Topic:
    """Return a bag's record of the topic, from its publishers; from subscriptions without any.

    Raises
    ------
    LookupError
        The definition of the topic's type is not installed.
    """
    type_name = ends[0].topic_type
    return Topic(
        name=name,
        type=type_name,
        definition=definition(type_name),
        type_hash=str(ends[0].topic_type_hash),
        offered_qos=[
            _as_metadata(end.qos_profile)
            for end in ends
            if end.endpoint_type == TopicEndpointTypeEnum.PUBLISHER
        ],
    )


def _as_metadata(profile: QoSProfile) -> dict[str, Any]:
    return {
        'history': profile.history.name.lower(),
        'depth': profile.depth,
        'reliability': profile.reliability.name.lower(),
        'durability': profile.durability.name.lower(),
        'deadline': _seconds(profile.deadline),
        'lifespan': _seconds(profile.lifespan),
        'liveliness': profile.liveliness.name.lower(),
        'liveliness_lease_duration': _seconds(profile.liveliness_lease_duration),
        'avoid_ros_namespace_conventions': profile.avoid_ros_namespace_conventions,
    }


def _seconds(duration: Duration) -> dict[str, int]:
    sec, nsec = divmod(duration.nanoseconds, 10**9)
    return {'sec': sec, 'nsec': nsec}
