"""The take of serialized messages: what the middleware says of each message."""

from __future__ import annotations

import time
from struct import Struct
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from std_msgs.msg import Int64

from barc_sim.ros import polled
from barc_sim.ros.polled import Taken, Taker

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rclpy.context import Context

#: A subscription that is created later receives what was published before.
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture
def nodes(ros: Context) -> Iterator[tuple[Node, Node]]:
    nodes = Node('publisher', context=ros), Node('subscriber', context=ros)
    yield nodes
    for node in nodes:
        node.destroy_node()


def test_messages_are_taken_with_their_times_number_and_publisher(nodes: tuple[Node, Node]) -> None:
    publishing, subscribing = nodes
    publisher = publishing.create_publisher(Int64, 'number', LATCHED)
    before = time.time_ns()
    for number in range(3):
        publisher.publish(Int64(data=number))
    after = time.time_ns()
    time.sleep(0.01)  # so that the two times of a message cannot be mistaken for each other
    subscribed = time.time_ns()
    subscription = subscribing.create_subscription(Int64, 'number', print, LATCHED, raw=True)
    taker = Taker(subscribing)
    taken: list[Taken] = []
    while len(taken) < 3:
        taken += map(Taken._make, taker.take(subscription, 10))
    taker.close()
    assert [deserialize_message(each.data, Int64).data for each in taken] == [0, 1, 2]
    assert all(before <= each.published <= after for each in taken)
    assert all(subscribed <= each.received <= time.time_ns() for each in taken)
    assert [each.number for each in taken] == [1, 2, 3]
    (info,) = subscribing.get_publishers_info_by_topic('number')
    assert {each.publisher for each in taken} == {bytes(info.endpoint_gid)}


def test_other_layouts_are_found_and_rclpys_own_take_is_used(
    nodes: tuple[Node, Node], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(polled, '_INFO', Struct('=8xqqQ16x16s'))
    publishing, subscribing = nodes
    taker = Taker(subscribing)
    subscription = subscribing.create_subscription(Int64, 'number', print, LATCHED, raw=True)
    publisher = publishing.create_publisher(Int64, 'number', LATCHED)
    publisher.publish(Int64(data=7))
    taken: list[Taken] = []
    while not taken:
        taken += map(Taken._make, taker.take(subscription, 10))
    taker.close()
    assert [deserialize_message(each.data, Int64).data for each in taken] == [7]
    assert [each.number for each in taken] == [1]
