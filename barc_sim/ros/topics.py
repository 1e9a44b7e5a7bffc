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

from barc_sim.bags.recording import Topic
from barc_sim.bags.schemas import definition, definition_of
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rclpy.node import Node
    from rclpy.topic_endpoint_info import TopicEndpointInfo

_RESPONSE_TIMEOUT = 5.0  #: [s]
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
    profiles = [end.qos_profile for end in ends]
    reliable = all(profile.reliability == ReliabilityPolicy.RELIABLE for profile in profiles)
    latched = all(profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for profile in profiles)
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def offer(recorded: Sequence[Mapping[str, Any]]) -> QoSProfile:
    """Return the QoS of a publisher in place of the recorded ones, in rosbag2's terms.

    Where these differ, it reaches every subscription that one of them reached.
    """
    if not recorded:
        return QoSProfile(depth=_DEPTH)
    profiles = [profile(each) for each in recorded]
    if all(each == profiles[0] for each in profiles):
        return profiles[0]
    reliable = any(each.reliability == ReliabilityPolicy.RELIABLE for each in profiles)
    latched = any(each.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in profiles)
    return QoSProfile(
        depth=_DEPTH,
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


def request_definition(
    node: Node, publisher: TopicEndpointInfo, on_response: Callable[[str | None], None]
) -> None:
    """Request the definition of a topic's type from its publisher, through `node`, which spins.

    `on_response` is called once, with the `ros2msg` schema, or None where there is none.
    """
    from type_description_interfaces.srv import GetTypeDescription  # noqa: PLC0415 (rare)

    namespace = publisher.node_namespace.rstrip('/')
    client = node.create_client(
        GetTypeDescription, f'{namespace}/{publisher.node_name}/get_type_description'
    )
    response = client.call_async(
        GetTypeDescription.Request(
            type_name=publisher.topic_type,
            type_hash=str(publisher.topic_type_hash),
            include_type_sources=False,
        )
    )

    def finish() -> None:
        timer.cancel()
        node.destroy_timer(timer)
        node.destroy_client(client)
        received = response.result() if response.done() else None
        on_response(_definition(publisher.topic_type, received))

    timer = node.create_timer(_RESPONSE_TIMEOUT, finish)
    response.add_done_callback(lambda _: finish() if not timer.is_canceled() else None)


def _definition(name: str, response: Any) -> str | None:  # noqa: ANN401 (a generated class)
    if not response or not response.successful:
        return None
    about = response.type_description
    types = [about.type_description, *about.referenced_type_descriptions]
    try:
        return definition_of(name, map(_as_json, types))
    except LookupError:
        return None


def _as_json(about: Any) -> dict[str, Any]:  # noqa: ANN401 (a generated class)
    names = ('type_id', 'capacity', 'string_capacity', 'nested_type_name')
    fields = [
        {'name': field.name, 'type': {name: getattr(field.type, name) for name in names}}
        for field in about.fields
    ]
    return {'type_name': about.type_name, 'fields': fields}
