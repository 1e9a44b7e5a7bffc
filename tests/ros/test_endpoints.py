"""Publishers and subscriptions without QoS events, and who cannot hear whom."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

from barc_interfaces.msg import ECU
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from barc_sim.bags.cdr import leading_time
from barc_sim.ros.conversions import to_header
from barc_sim.ros.endpoints import (
    drained_subscription,
    incompatible_peers,
    publisher,
    subscription,
)
from barc_sim.ros.names import QOS

if TYPE_CHECKING:
    from collections.abc import Callable

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


def test_peer_whose_messages_cannot_be_received_is_named(node: Node, ros: Context) -> None:
    subscription(node, ECU, 'ecu', lambda _: None, MutuallyExclusiveCallbackGroup())
    peer = Node('joystick', context=ros)
    peer.create_publisher(ECU, 'ecu', BEST_EFFORT)
    (sentence,) = incompatible_peers(node)
    assert sentence.startswith('car cannot receive /ecu from joystick: ')
    assert 'reliab' in sentence.lower()


def test_peer_that_cannot_receive_is_named(node: Node, ros: Context) -> None:
    publisher(node, ECU, 'ecu')
    peer = Node('view', context=ros)
    peer.create_subscription(ECU, 'ecu', lambda _: None, LATCHED)
    (sentence,) = incompatible_peers(node)
    assert sentence.startswith('view cannot receive /ecu from car: ')


def test_peers_that_fit_and_topics_of_others_are_not_named(node: Node, ros: Context) -> None:
    publisher(node, ECU, 'ecu')
    peer = Node('view', context=ros)
    peer.create_subscription(ECU, 'ecu', lambda _: None, BEST_EFFORT)
    peer.create_publisher(ECU, 'elsewhere', BEST_EFFORT)
    peer.create_subscription(ECU, 'elsewhere', lambda _: None, LATCHED)
    assert list(incompatible_peers(node)) == []


def test_all_that_waits_is_handed_over_at_once_and_in_order(
    node: Node, ros: Context, spin_until: Callable[..., None]
) -> None:
    heard: list[int] = []
    drain = drained_subscription(
        node,
        ECU,
        'ecu',
        lambda data: heard.append(leading_time(data)),
        MutuallyExclusiveCallbackGroup(),
    )
    sends = publisher(node, ECU, 'ecu')
    for stamp in range(50):
        sends.publish(ECU(header=to_header(stamp)))
    end = time.monotonic() + 20.0
    while len(heard) < 50:
        drain()
        assert time.monotonic() < end
    executor = SingleThreadedExecutor(context=ros)
    executor.add_node(node)
    sends.publish(ECU(header=to_header(50)))
    spin_until(executor, lambda: len(heard) > 50)
    executor.shutdown()
    assert heard == list(range(51))
