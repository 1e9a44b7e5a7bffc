"""Messages from records, stamps and the driver's input, and back; `poses` has those of poses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Twist, Vector3
from std_msgs.msg import Header

from barc_sim.control.driver import DriverInput
from barc_sim.interfaces.stamps import split_time

if TYPE_CHECKING:
    from rclpy.node import Node

Message = TypeVar('Message')


def frames(node: Node) -> tuple[str, str]:
    """Return the frames of map and car; in the namespace `/car2`, `map` and `car2/base_link`."""
    namespace = node.get_namespace().strip('/')
    return 'map', f'{namespace}/base_link' if namespace else 'base_link'


def fill(message: Message, record: Any) -> Message:  # noqa: ANN401 (a NamedTuple)
    """Copy the fields of `record` to those of `message` by name; return the message."""
    for name, value in zip(record._fields, record, strict=True):
        setattr(message, name, value)
    return message


def to_header(stamp_ns: int, frame_id: str = '') -> Header:
    """Return a header stamped `stamp_ns` [ns]."""
    sec, nanosec = split_time(stamp_ns)
    return Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=frame_id)


def to_driver_input(twist: Twist) -> DriverInput:
    """Return the driver's input in `twist`."""
    return DriverInput(forward=twist.linear.x, turn=twist.angular.z, brake=-twist.linear.z)


def to_twist(request: DriverInput) -> Twist:
    """Return the driver's input `request` as a Twist."""
    return Twist(
        linear=Vector3(x=request.forward, z=-request.brake or 0.0), angular=Vector3(z=request.turn)
    )
