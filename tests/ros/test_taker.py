"""Messages are taken with their times, their number and their publisher."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest
from command_line import wait_for
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from std_msgs.msg import Int64

from barc_sim.ros.recording.polled import Taker

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
    subscription = subscribing.create_subscription(
        Int64, 'number', lambda _: None, LATCHED, raw=True
    )
    taker, taken = Taker(), []
    wait_for(lambda: taken.extend(taker.take(subscription, 10)) or len(taken) == 3)
    taker.close()
    data, published, received, numbers, publishers = zip(*taken, strict=True)
    assert [deserialize_message(each, Int64).data for each in data] == [0, 1, 2]
    assert all(before <= each <= after for each in published)
    assert all(subscribed <= each <= time.time_ns() for each in received)
    assert numbers == (1, 2, 3)

    (info,) = subscribing.get_publishers_info_by_topic('number')
    assert {*publishers} == {bytes(info.endpoint_gid)}
