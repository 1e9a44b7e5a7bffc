"""Converts messages to and from the records of the rooms without ROS."""

from __future__ import annotations

from math import atan2
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, Twist, Vector3
from std_msgs.msg import Header

from barc_sim.bags.messages import NANOSECONDS, split_time
from barc_sim.control.driver import DriverInput
from barc_sim.vehicle.bike_model import State

#: [m] No road leads farther.
_FAR = 1e6
#: Tolerance of the squared norm of a quaternion that is a rotation.
_NORM_TOLERANCE = 1e-3


def to_header(stamp_ns: int, frame_id: str = '') -> Header:
    """Return a header stamped `stamp_ns` [ns]."""
    sec, nanosec = split_time(stamp_ns)
    return Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=frame_id)


def fill(message: Any, header: Header, record: Any) -> Any:  # noqa: ANN401 (of one's fields)
    """Return `message` with `header` and the fields of a NamedTuple; a new one would cost more."""
    message.header = header
    for name, value in zip(record._fields, record, strict=True):
        setattr(message, name, value)
    return message


def to_nanoseconds(stamp: Time) -> int:
    """Return `stamp` in nanoseconds."""
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def to_state_at_rest(pose: Pose) -> State | None:
    """Return the state at rest at `pose`; None where that is not finite or not a rotation."""
    x, y, q = pose.position.x, pose.position.y, pose.orientation
    norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
    if not (max(abs(x), abs(y)) <= _FAR and abs(norm - 1.0) < _NORM_TOLERANCE):
        return None
    return State(x, y, atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z)))


def to_driver_input(twist: Twist) -> DriverInput:
    """Return the driver's input in `twist`."""
    return DriverInput(forward=twist.linear.x, turn=twist.angular.z, brake=-twist.linear.z)


def to_twist(request: DriverInput) -> Twist:
    """Return `request` as a message."""
    return Twist(
        linear=Vector3(x=request.forward, z=-request.brake or 0.0), angular=Vector3(z=request.turn)
    )
