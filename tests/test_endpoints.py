"""Publishers and subscriptions without QoS events, and who cannot hear whom."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

from barc_interfaces.msg import ECU
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from barc_sim.endpoints import incompatible_peers, publisher, subscription
from barc_sim.topic_names import QOS

if TYPE_CHECKING:
    from rclpy.context import Context

BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)


@pytest.fixture
def node(ros: Context) -> Node:
    return Node('car', context=ros)


def test_endpoints_are_reliable_and_wait_for_no_events(node: Node) -> None:
    group = MutuallyExclusiveCallbackGroup()
    ends = [
        publisher(node, ECU, 'ecu'),
        subscription(node, ECU, 'ecu', lambda _: None, group),
    ]
    for end in ends:
        assert end.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        assert end.qos_profile.depth == QOS.depth
        assert not end.event_handlers
    assert ends[1].callback_group is group


def test_peer_whose_messages_cannot_be_heard_is_named(node: Node, ros: Context) -> None:
    subscription(node, ECU, 'ecu', lambda _: None, MutuallyExclusiveCallbackGroup())
    peer = Node('joystick', context=ros)
    peer.create_publisher(ECU, 'ecu', BEST_EFFORT)
    (sentence,) = incompatible_peers(node)
    assert sentence.startswith('car cannot hear joystick on /ecu: ')
    assert 'reliab' in sentence.lower()


def test_peer_that_cannot_hear_is_named(node: Node, ros: Context) -> None:
    publisher(node, ECU, 'ecu')
    peer = Node('view', context=ros)
    peer.create_subscription(ECU, 'ecu', lambda _: None, LATCHED)
    (sentence,) = incompatible_peers(node)
    assert sentence.startswith('view cannot hear car on /ecu: ')


def test_peers_that_fit_and_topics_of_others_are_not_named(node: Node, ros: Context) -> None:
    publisher(node, ECU, 'ecu')
    peer = Node('view', context=ros)
    peer.create_subscription(ECU, 'ecu', lambda _: None, BEST_EFFORT)
    peer.create_publisher(ECU, 'elsewhere', BEST_EFFORT)
    peer.create_subscription(ECU, 'elsewhere', lambda _: None, LATCHED)
    assert list(incompatible_peers(node)) == []
