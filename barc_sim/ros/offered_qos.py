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

from barc_sim.bags.metadata import Topic
from barc_sim.bags.schemas import definition

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rclpy.duration import Duration
    from rclpy.topic_endpoint_info import TopicEndpointInfo


def request(publishers: Sequence[TopicEndpointInfo], depth: int) -> QoSProfile:
    """Return the strongest QoS that all publishers offer, as rosbag2 requests it."""
    profiles = [publisher.qos_profile for publisher in publishers]
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


def describe(
    name: str, publishers: Sequence[TopicEndpointInfo], definitions: Mapping[str, str]
) -> Topic:
    """Return a bag's record of the topic.

    `definitions` has the `ros2msg` schemas of types that are installed without theirs.

    Raises
    ------
    LookupError
        The definition of the topic's type is neither given nor installed.
    """
    type_name = publishers[0].topic_type
    return Topic(
        name=name,
        type=type_name,
        definition=definitions.get(type_name) or definition(type_name),
        type_hash=str(publishers[0].topic_type_hash),
        offered_qos=[_as_metadata(publisher.qos_profile) for publisher in publishers],
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
