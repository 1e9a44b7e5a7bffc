"""Publishes and reads messages by their fields, as bytes where their layout is fixed.

Making a message object and serializing it takes 9 us, packing its bytes 3 us. A run in lock-step
does little else.
"""

from __future__ import annotations

from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from rclpy.serialization import deserialize_message

from barc_sim.bags.cdr import FixedLayout, fixed_layout
from barc_sim.ros.conversions import to_header
from barc_sim.ros.endpoints import publisher
from barc_sim.ros.introspection.messages import message_class

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rclpy.node import Node


class FieldPublisher:
    """Publishes messages whose first field is a header or a time.

    Examples
    --------
    >>> import rclpy
    >>> from barc_interfaces.msg import ECU
    >>> from barc_sim.ros.executor import PolledCallbackGroup
    >>> from barc_sim.ros.polled import polled, take
    >>> rclpy.init()
    >>> node = rclpy.create_node('driver')
    >>> subscription = polled(node, ECU, 'ecu', 1, PolledCallbackGroup())
    >>> commands = FieldPublisher(node, 'ecu', 'barc_interfaces/msg/ECU')
    >>> commands.publish(1_020_000_000, {'motor': 2.0, 'servo': 0.0})
    >>> [message.motor for message, _ in take(subscription, 1)]
    [2.0]
    """

    wanted = True  #: always: asking DDS for subscriptions would cost more than a message

    def __init__(self, node: Node, topic: str, type_name: str) -> None:
        """Create the publisher of `node` on `topic`, of a type such as `std_msgs/msg/Header`."""
        message_type = message_class(type_name)
        layout = _layout(message_type)
        self._make = layout.pack if layout else partial(_make, message_type)
        self._publish = publisher(node, message_type, topic).publish

    def publish(self, stamp: int, fields: Mapping[str, Any]) -> None:
        """Publish the message stamped `stamp` [ns] with `fields`, by name."""
        self._publish(self._make(stamp, fields))


def _make(message_type: type[Any], stamp: int, fields: Mapping[str, Any]) -> Any:  # noqa: ANN401
    return message_type(header=to_header(stamp), **fields)


def field_reader(message_type: type[Any], *names: str) -> Callable[[bytes], Any]:
    """Return a function that reads fields of a serialized message: one value, or several.

    Examples
    --------
    >>> from barc_interfaces.msg import ECU
    >>> from rclpy.serialization import serialize_message
    >>> read = field_reader(ECU, 'motor', 'servo')
    >>> read(serialize_message(ECU(motor=2.0, servo=-0.1)))
    (2.0, -0.1)
    """
    layout, select = _layout(message_type), attrgetter(*names)
    assert layout, message_type  # noqa: S101 (of the types that nodes read)
    read, fits = layout.reader(*names), layout.fits

    def read_any(data: bytes) -> Any:  # noqa: ANN401
        return read(data) if fits(data) else select(deserialize_message(data, message_type))

    return read_any


def _layout(message_type: type[Any]) -> FixedLayout | None:
    return fixed_layout(message_type.get_fields_and_field_types())
