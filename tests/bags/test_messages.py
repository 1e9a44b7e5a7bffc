"""The messages of a run without ROS are those of ROS, byte by byte."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip('rclpy')

from barc_interfaces.msg import ECU, ControllerState, PidState, ZDynBkMdl
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Twist, Vector3
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

from barc_sim.bags.messages import message_class, packer
from barc_sim.bags.schemas import share, shipped

if TYPE_CHECKING:
    from pathlib import Path

STAMP = 7_000_000_008
HEADER = Header(stamp=Time(sec=7, nanosec=8))
PID = {
    'reference': 8.0,
    'measurement': 7.5,
    'error': 0.5,
    'proportional': 1.0,
    'integral': -2.0,
    'derivative': 3.0,
    'output': 2.0,
    'saturated': True,
}
LQR = {name: PID[name] for name in ('reference', 'measurement', 'error', 'output', 'saturated')}
LQR |= {'names': ['a', 'longer'], 'values': [1.5, -2.5]}
STATE = {'x': 1.0, 'y': -2.0, 'psi': 0.1, 'v_x': 8.0, 'v_y': 0.0, 'psi_dot': 1e-9}


@pytest.mark.parametrize(
    ('kind', 'fields'),
    [
        (ECU, {'motor': 1.0, 'servo': -0.5}),
        (ZDynBkMdl, STATE),
        (PidState, PID),
        (ControllerState, LQR),
    ],
)
def test_message_is_packed_as_ros_does(kind: type, fields: dict[str, Any]) -> None:
    message = kind(header=HEADER, **fields)
    data = packer(f'barc_interfaces/msg/{kind.__name__}')(STAMP, fields)
    # ROS leaves what was in memory before in the bytes between the fields.
    assert len(data) == len(serialize_message(message))
    assert deserialize_message(data, kind) == message


def test_messages_without_a_header_are_packed_as_ros_does() -> None:
    clock = serialize_message(Clock(clock=Time(sec=7, nanosec=8)))
    assert packer('rosgraph_msgs/msg/Clock')(STAMP, {}) == clock
    vector = message_class('geometry_msgs/msg/Vector3')
    fields = {'linear': vector(x=1.0, y=0.0, z=-1.0), 'angular': vector(x=0.0, y=0.0, z=0.5)}
    twist = Twist(linear=Vector3(x=1.0, z=-1.0), angular=Vector3(z=0.5))
    assert packer('geometry_msgs/msg/Twist')(STAMP, fields) == serialize_message(twist)


@pytest.mark.parametrize(('name', 'path'), sorted(shipped()))
def test_definition_is_that_of_ros(name: str, path: Path) -> None:
    package, _, base = name.split('/')
    installed = share(package) / 'msg' / f'{base}.msg'
    assert path.read_text(encoding='utf-8') == installed.read_text(encoding='utf-8')
