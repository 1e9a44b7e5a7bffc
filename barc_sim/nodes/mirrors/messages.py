"""The mirrors' messages; each is made once, and filled again for every state."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import AccelStamped, Point, PoseStamped, TransformStamped
from nav_msgs.msg import Odometry, Path
from sensor_msgs.msg import JointState

from barc_sim.ros.conversions import NANOSECONDS, to_header

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from std_msgs.msg import Header

    from barc_sim.nodes.mirrors.car import Pose
    from barc_sim.nodes.mirrors.diagnosis import Diagnosis
    from barc_sim.nodes.mirrors.ride import Seen

ODOM, BASE = 'odom', 'base_link'
_WHEELS = ('front_left', 'front_right', 'rear_left', 'rear_right')
JOINTS = (
    'front_left_steering',
    'front_right_steering',
    *(f'{wheel}_wheel' for wheel in _WHEELS),
)
_TURN = 2.0 * pi


class OdometryMirror:
    """The pose in `odom` and the velocity in `base_link`, as measured; covariances are not told."""

    def __init__(self, prefix: str) -> None:
        """Put `prefix` before the frames' names."""
        self._message = Odometry(header=to_header(0, prefix + ODOM), child_frame_id=prefix + BASE)

    def of(self, seen: Seen) -> Odometry:
        """Return a state's message, to be published before the next is asked for."""
        message = self._message
        stamp(message.header, seen.stamp)
        put(message.pose.pose, seen.pose)
        twist = message.twist.twist
        twist.linear.x, twist.linear.y = seen.motion.v_x, seen.motion.v_y
        twist.angular.z = seen.motion.psi_dot
        return message


class TransformMirror:
    """The pose as a transform from `odom` to `base_link`."""

    def __init__(self, prefix: str, kind: type[Any]) -> None:
        """Put `prefix` before the frames' names; `kind` is tf2_msgs/TFMessage."""
        self._transform = TransformStamped(
            header=to_header(0, prefix + ODOM), child_frame_id=prefix + BASE
        )
        self._message = kind(transforms=[self._transform])

    def of(self, seen: Seen) -> Any:  # noqa: ANN401 (tf2_msgs may be missing)
        """Return a state's message, to be published before the next is asked for."""
        stamp(self._transform.header, seen.stamp)
        transform = self._transform.transform
        there = transform.translation
        there.x, there.y, there.z = seen.pose[:3]
        turn = transform.rotation
        turn.x, turn.y, turn.z, turn.w = seen.pose.orientation
        return self._message


class AccelerationMirror:
    """The acceleration over the ground, in `base_link`: gravity has no part in it."""

    def __init__(self, prefix: str) -> None:
        """Put `prefix` before the frame's name."""
        self._message = AccelStamped(header=to_header(0, prefix + BASE))

    def of(self, seen: Seen) -> AccelStamped:
        """Return a state's message, to be published before the next is asked for."""
        stamp(self._message.header, seen.stamp)
        accel = self._message.accel
        accel.linear.x, accel.linear.y, accel.angular.z = seen.acceleration
        return self._message


class JointMirror:
    """The front wheels' steering, and how far each wheel has turned and how fast it does.

    The velocity of the steering is not told.
    """

    def __init__(self, prefix: str) -> None:
        """Put `prefix` before the joints' names."""
        self._message = JointState(header=to_header(0), name=[prefix + joint for joint in JOINTS])

    def of(self, seen: Seen) -> JointState:
        """Return a state's message, to be published before the next is asked for."""
        stamp(self._message.header, seen.stamp)
        left, right = (wheel.steering for wheel in seen.wheels[:2])
        self._message.position = [left, right, *(angle % _TURN for angle in seen.rolled)]
        self._message.velocity = [0.0, 0.0, *(wheel.speed for wheel in seen.wheels)]
        return self._message


def to_path(poses: Iterable[tuple[int, Pose]], prefix: str) -> Path:
    """Return the way so far, poses with their stamps [ns], stamped as the last of them."""
    message = Path()
    for at, pose in poses:
        header = to_header(at, prefix + ODOM)
        message.poses.append(put_stamped(PoseStamped(header=header), pose))
        message.header = header
    return message


def to_diagnostics(found: Sequence[Diagnosis], stamp_ns: int, source: str) -> DiagnosticArray:
    """Return `found`, each under the name of its `source`."""
    return DiagnosticArray(
        header=to_header(stamp_ns),
        status=[
            DiagnosticStatus(
                level=bytes([diagnosis.level]),
                name=f'{source}: {diagnosis.name}',
                message=diagnosis.message,
                hardware_id='barc_sim',
                values=[KeyValue(key=key, value=value) for key, value in diagnosis.values.items()],
            )
            for diagnosis in found
        ],
    )


def stamp(header: Header, stamp_ns: int) -> None:
    """Stamp `header` anew."""
    header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns, NANOSECONDS)


def put(message: Any, pose: Pose) -> None:  # noqa: ANN401 (geometry_msgs/Pose)
    """Fill a message with `pose`."""
    there, turn = message.position, message.orientation
    there.x, there.y, there.z = pose.x, pose.y, pose.z
    turn.x, turn.y, turn.z, turn.w = pose.orientation


def put_stamped(message: PoseStamped, pose: Pose) -> PoseStamped:
    """Return the message, filled with `pose`."""
    put(message.pose, pose)
    return message


def point(x: float, y: float, z: float) -> Point:
    """Return a point [m]."""
    return Point(x=x, y=y, z=z)
