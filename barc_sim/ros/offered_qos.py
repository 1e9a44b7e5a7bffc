"""The QoS that publishers offer: what a subscription requests, and what a bag records of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy.qos import (
    DurabilityPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.topic_endpoint_info import TopicEndpointTypeEnum

from barc_sim.bags.recording import Topic
from barc_sim.bags.schemas import definition

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rclpy.duration import Duration
    from rclpy.topic_endpoint_info import TopicEndpointInfo


def request(ends: Sequence[TopicEndpointInfo], depth: int) -> QoSProfile:
    """Return the strongest QoS that all publishers offer, as rosbag2 requests it.

    Of subscriptions, the QoS that gets every message that one of them gets.
    """
    profiles = [end.qos_profile for end in ends]
    reliable = all(profile.reliability == ReliabilityPolicy.RELIABLE for profile in profiles)
    latched = all(profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for profile in profiles)
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def matches(publisher: TopicEndpointInfo, requested: QoSProfile) -> bool:
    """Return whether a subscription that requests this QoS gets the publisher's messages."""
    compatibility, _ = qos_check_compatible(publisher.qos_profile, requested)
    return bool(compatibility != QoSCompatibility.ERROR)


def same_strength(one: QoSProfile, other: QoSProfile) -> bool:
    """Return whether both request the same of a publisher."""
    return bool(one.reliability == other.reliability and one.durability == other.durability)


def describe(name: str, ends: Sequence[TopicEndpointInfo], definitions: Mapping[str, str]) -> Topic:
    """Return a bag's record of the topic, from its publishers; from subscriptions without any.

    `definitions` has the `ros2msg` schemas of types that are installed without theirs.

    Raises
    ------
    LookupError
        The definition of the topic's type is neither given nor installed.
    """
    type_name = ends[0].topic_type
    return Topic(
        name=name,
        type=type_name,
        definition=definitions.get(type_name) or definition(type_name),
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
