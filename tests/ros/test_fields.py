"""Messages published and read by their fields are those of rclpy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

from barc_interfaces.msg import ECU
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message

from barc_sim.ros.conversions import to_header
from barc_sim.ros.fields import FieldPublisher, field_reader
from barc_sim.ros.introspection.messages import message_class

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context
    from rclpy.executors import Executor

LQR = {
    'reference': 8.0,
    'measurement': 7.5,
    'error': 0.5,
    'names': ['a', 'longer'],
    'values': [1.5, -2.5],
    'output': 2.0,
    'saturated': True,
}


@pytest.mark.parametrize(
    ('type_name', 'fields'),
    [
        ('barc_interfaces/msg/ECU', {'motor': 1.0, 'servo': -0.5}),
        ('barc_interfaces/msg/ControllerState', LQR),  # its length varies
    ],
)
def test_subscription_gets_the_fields_that_were_published(
    ros: Context,
    spin_until: Callable[[Executor, Callable[[], bool]], None],
    type_name: str,
    fields: dict[str, object],
) -> None:
    node = Node('node', context=ros)
    executor = SingleThreadedExecutor(context=ros)
    executor.add_node(node)
    kind = message_class(type_name)
    got: list[object] = []
    node.create_subscription(kind, 'topic', got.append, 10)
    FieldPublisher(node, 'topic', type_name).publish(3_000_000_004, fields)
    spin_until(executor, lambda: bool(got))
    executor.shutdown()

    assert got == [kind(header=to_header(3_000_000_004), **fields)]


@pytest.mark.parametrize('frame', ['', 'm', 'map', 'a_long_frame'])
def test_fields_are_read_whatever_the_frame_is(frame: str) -> None:
    message = ECU(header=to_header(5, frame), motor=1.5, servo=-0.25)
    data = serialize_message(message)

    assert deserialize_message(data, ECU) == message
    assert field_reader(ECU, 'motor', 'servo')(data) == (1.5, -0.25)
    assert field_reader(ECU, 'servo')(data) == -0.25
