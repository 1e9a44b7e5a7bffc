"""The QoS that a user sets for a topic."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip('rclpy')

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from std_msgs.msg import Float64

from barc_sim.ros.topics import overriding

if TYPE_CHECKING:
    from rclpy.context import Context


def test_each_policy_of_the_file_is_set_and_the_others_are_default() -> None:
    policies = {
        'depth': 3,
        'history': 'keep_all',
        'reliability': 'best_effort',
        'durability': 'transient_local',
        'deadline': {'sec': 1, 'nsec': 5},
        'lifespan': {'sec': 2, 'nsec': 0},
        'liveliness': 'manual_by_topic',
        'liveliness_lease_duration': {'sec': 0, 'nsec': 7},
        'avoid_ros_namespace_conventions': True,
    }
    assert overriding(policies, 10) == QoSProfile(
        depth=3,
        history=HistoryPolicy.KEEP_ALL,
        reliability=ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
        deadline=Duration(seconds=1, nanoseconds=5),
        lifespan=Duration(seconds=2),
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
        liveliness_lease_duration=Duration(nanoseconds=7),
        avoid_ros_namespace_conventions=True,
    )
    assert overriding({}, 10) == overriding({'depth': 0}, 10) == QoSProfile(depth=10)


@pytest.mark.parametrize(
    'policies',
    [
        {'history': 'keep_all', 'depth': 0},
        {'history': 'system_default', 'liveliness': 'system_default'},
        {'reliability': 'system_default', 'durability': 'system_default'},
        {'reliability': 'best_available', 'durability': 'best_available'},
        {'deadline': {'sec': 9_223_372_036, 'nsec': 854_775_807}},
    ],
)
def test_ros_accepts_it_of_publishers_and_subscriptions(
    ros: Context, policies: dict[str, Any]
) -> None:
    node = Node('talker', context=ros)
    qos = overriding(policies, 10)
    node.create_publisher(Float64, 'value', qos)
    node.create_subscription(Float64, 'value', lambda _: None, qos)
    node.destroy_node()
