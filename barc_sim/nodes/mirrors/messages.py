"""The mirrors' messages: each is made once, and filled anew for every state."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import AccelStamped, PoseStamped, TransformStamped
from nav_msgs.msg import Odometry, Path
from sensor_msgs.msg import JointState

from barc_sim.bags.cdr import NANOSECONDS
from barc_sim.ros.conversions import to_header

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from std_msgs.msg import Header

    from barc_sim.nodes.mirrors.car import Pose
    from barc_sim.nodes.mirrors.diagnosis import Diagnosis
    from barc_sim.nodes.mirrors.ride import MirroredState

    #: Returns the message of a state; the next call fills it anew.
    Mirror = Callable[[MirroredState], Any]

ODOM, BASE = 'odom', 'base_link'
_WHEELS = ('front_left', 'front_right', 'rear_left', 'rear_right')
JOINTS = (
    'front_left_steering',
    'front_right_steering',
    *(f'{wheel}_wheel' for wheel in _WHEELS),
)
_FULL_TURN = 2.0 * pi


def odometry_mirror(prefix: str) -> Mirror:
    """Return what shows the pose in `odom` and the velocity in `base_link`, without covariances.

    They are as measured. `prefix` comes before the frames' names.

    Examples
    --------
    >>> from barc_sim.nodes.mirrors.ride import Ride
    >>> from barc_sim.vehicle.bike_model import Motion, Vehicle
    >>> from barc_sim.vehicle.road import Road
    >>> motion = Motion(60.0, 0.0, 0.0, v_x=8.0, v_y=0.0, psi_dot=0.0)
    >>> state = Ride(Road.named('lab'), Vehicle()).update(0, motion, servo=0.0)
    >>> message = odometry_mirror('car2/')(state)
    >>> message.child_frame_id, message.twist.twist.linear.x
    ('car2/base_link', 8.0)
    """
    message = Odometry(header=to_header(0, prefix + ODOM), child_frame_id=prefix + BASE)
    twist = message.twist.twist

    def mirror(state: MirroredState) -> Odometry:
        stamp(message.header, state.stamp)
        fill(message.pose.pose, state.pose)
        twist.linear.x, twist.linear.y = state.motion.v_x, state.motion.v_y
        twist.angular.z = state.motion.psi_dot
        return message

    return mirror


def transform_mirror(prefix: str, kind: type[Any]) -> Mirror:
    """Return what shows the pose as a transform from `odom` to `base_link`.

    `prefix` comes before the frames' names; `kind` is tf2_msgs/TFMessage.
    """
    stamped = TransformStamped(header=to_header(0, prefix + ODOM), child_frame_id=prefix + BASE)
    message = kind(transforms=[stamped])
    there, turn = stamped.transform.translation, stamped.transform.rotation

    def mirror(state: MirroredState) -> Any:  # noqa: ANN401 (tf2_msgs may be missing)
        stamp(stamped.header, state.stamp)
        there.x, there.y, there.z = state.pose[:3]
        turn.x, turn.y, turn.z, turn.w = state.pose.orientation
        return message

    return mirror


def acceleration_mirror(prefix: str) -> Mirror:
    """Return what shows the acceleration over the ground, in `base_link`, without gravity.

    `prefix` comes before the frame's name.

    Examples
    --------
    >>> from barc_sim.nodes.mirrors.ride import Ride
    >>> from barc_sim.vehicle.bike_model import Motion, Vehicle
    >>> from barc_sim.vehicle.road import Road
    >>> ride = Ride(Road.named('lab'), Vehicle())
    >>> circling = Motion(0.0, 0.0, 0.0, v_x=8.0, v_y=0.0, psi_dot=0.5)
    >>> _ = ride.update(0, circling, servo=0.2)
    >>> state = ride.update(20_000_000, circling, servo=0.2)
    >>> acceleration_mirror('car2/')(state).accel.linear.y
    4.0
    """
    message = AccelStamped(header=to_header(0, prefix + BASE))
    accel = message.accel

    def mirror(state: MirroredState) -> AccelStamped:
        stamp(message.header, state.stamp)
        accel.linear.x, accel.linear.y, accel.angular.z = state.acceleration
        return message

    return mirror


def joint_mirror(prefix: str) -> Mirror:
    """Return what shows the front wheels' steering, and the rolling angle and speed of each wheel.

    The steering's velocity is always 0. `prefix` comes before the joints' names.

    Examples
    --------
    >>> from barc_sim.nodes.mirrors.ride import Ride
    >>> from barc_sim.vehicle.bike_model import Motion, Vehicle
    >>> from barc_sim.vehicle.road import Road
    >>> turning = Motion(0.0, 0.0, 0.0, v_x=8.0, v_y=0.0, psi_dot=0.8)
    >>> state = Ride(Road.named('lab'), Vehicle()).update(0, turning, servo=0.3)
    >>> joints = joint_mirror('')(state)
    >>> joints.name[0], round(joints.position[0], 3)
    ('front_left_steering', 0.327)
    """
    message = JointState(header=to_header(0), name=[prefix + joint for joint in JOINTS])

    def mirror(state: MirroredState) -> JointState:
        stamp(message.header, state.stamp)
        left, right = (wheel.steering for wheel in state.wheels[:2])
        message.position = [left, right, *(angle % _FULL_TURN for angle in state.rolled)]
        message.velocity = [0.0, 0.0, *(wheel.speed for wheel in state.wheels)]
        return message

    return mirror


def to_path(poses: Iterable[tuple[int, Pose]], prefix: str) -> Path:
    """Return the path of poses with their stamps [ns]; its stamp is the last one's.

    Examples
    --------
    >>> from barc_sim.nodes.mirrors.car import pose
    >>> from barc_sim.vehicle.bike_model import Motion
    >>> from barc_sim.vehicle.road import Road
    >>> there = pose(Motion(60.0, 0.0, 0.0, 8.0, 0.0, 0.0), Road.named('lab'))
    >>> path = to_path([(7_500_000_000, there)], 'car2/')
    >>> path.header.frame_id, path.header.stamp.sec, round(path.poses[0].pose.position.z, 2)
    ('car2/odom', 7, 3.47)
    """
    message = Path()
    for at, pose in poses:
        stamped = PoseStamped(header=to_header(at, prefix + ODOM))
        fill(stamped.pose, pose)
        message.poses.append(stamped)
        message.header = stamped.header
    return message


def to_diagnostics(diagnoses: Sequence[Diagnosis], stamp_ns: int, source: str) -> DiagnosticArray:
    """Return the diagnoses of the node `source`.

    Examples
    --------
    >>> from barc_sim.nodes.mirrors.diagnosis import Facts, Measured, diagnose
    >>> diagnoses = diagnose(Facts(missed=3), Facts(missed=1), Measured())
    >>> [status] = to_diagnostics(diagnoses, 1_020_000_000, '/mirror').status
    >>> status.name, status.message
    ('/mirror: timing', '2 commands missed their deadline')
    """
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
            for diagnosis in diagnoses
        ],
    )


def stamp(header: Header, stamp_ns: int) -> None:
    """Set the stamp of `header` [ns].

    Examples
    --------
    >>> from std_msgs.msg import Header
    >>> header = Header()
    >>> stamp(header, 1_020_000_000)
    >>> header.stamp.sec, header.stamp.nanosec
    (1, 20000000)
    """
    header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns, NANOSECONDS)


def fill(message: Any, pose: Pose) -> None:  # noqa: ANN401 (geometry_msgs/Pose)
    """Fill a message with `pose`.

    Examples
    --------
    >>> from geometry_msgs.msg import Pose
    >>> from barc_sim.nodes.mirrors import car
    >>> from barc_sim.vehicle.bike_model import Motion
    >>> from barc_sim.vehicle.road import Road
    >>> message = Pose()
    >>> fill(message, car.pose(Motion(60.0, 0.0, 0.0, 8.0, 0.0, 0.0), Road.named('lab')))
    >>> round(message.position.z, 2)
    3.47
    """
    there, turn = message.position, message.orientation
    there.x, there.y, there.z = pose.x, pose.y, pose.z
    turn.x, turn.y, turn.z, turn.w = pose.orientation
