"""The node `mirror`: repeats the simulator's states in the messages of ROS's own tools.

Frames are those of REP-103 and REP-105: x forward, y to the left, z up. `odom` is level, and has
its origin where the road's distance is zero. `base_link` lies on the road's surface under the
centre of mass. The road is level across: its grade first pitches the frame, then the car's heading
turns it within the surface. Uphill is a negative pitch.
"""

from __future__ import annotations

import time
from collections import deque
from itertools import pairwise
from math import cos, hypot, isfinite, radians, sin
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from barc_interfaces.msg import ZDynBkMdl
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, TransformStamped, Vector3
from nav_msgs.msg import Odometry, Path
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from barc_sim.interfaces import qos, topics
from barc_sim.interfaces.parameters import ParameterDeclaration
from barc_sim.interfaces.stamps import NANOSECONDS, to_nanoseconds
from barc_sim.ros.node_helpers import (
    declare,
    declare_track,
    frames,
    to_header,
    to_poses,
)
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from barc_sim.vehicle.track import Track

    Colour = tuple[float, float, float]
    Size = tuple[float, float, float]

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # PyPI has no wheel of it
    TFMessage = None

_OK, _WARN, _ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
PARAMETERS = [ParameterDeclaration('road', 'lab', "the simulator's road", read_only=True)]
#: Minimum [s] of wall-clock time between two markers of the car: 25 a second for states at 50 Hz.
_MARKERS_PERIOD = 0.035
_MAX_POSES, _SPACING = 400, 0.5  #: poses of the path, and [m] between two of them
_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

_BLUE, _SKY = (0.0, 0.447, 0.698), (0.337, 0.706, 0.914)
_SURFACE, _PAINT = (0.49, 0.467, 0.416), (0.9, 0.9, 0.9)
_LENGTH = 4.4  #: [m] of the car
_ROAD_WIDTH = 6.0  #: [m]
_LINE_WIDTH = 0.12  #: [m]
_MARGIN = 200.0  #: [m] of road before the first stretch's end and after the last stretch's start
#: [s] by which stamps may be behind the wall clock: a usual tolerance of nodes that use tf2.
_MAX_STAMP_LAG = 0.1


class RunDiagnostics(NamedTuple):
    """What no topic carries of a run; None where unknown."""

    missed: int | None = None  #: commands that missed their deadline
    slipped: int | None = None  #: periods by which simulated time fell behind the wall clock
    recorded: int | None = None  #: messages in the bag
    lost: int | None = None  #: messages lost
    failure: str | None = None  #: why the bag could not be written
    stamp_lag: float | None = None  #: [s] by which stamps in real time are behind the wall clock


class MirrorNode(Node):
    """Publishes each `z_vhcl` again in standard messages.

    They show the measured state on the simulator's road, which the parameter `road` names. In
    `z_vhcl`, `x` is the distance along the road's surface; here it is the horizontal distance. On a
    track both are horizontal: its hills are not shown. The frames are `odom`, equal to `map`, and
    `base_link`; in the namespace `/car2`, `car2/odom` and `car2/base_link`.

    Examples
    --------
    >>> import rclpy
    >>> from rclpy.task import Future
    >>> rclpy.init()
    >>> mirror, odometry = MirrorNode(), Future()
    >>> _ = mirror.create_subscription(Odometry, 'odom', odometry.set_result, 1)
    >>> mirror.create_publisher(ZDynBkMdl, 'z_vhcl', 1).publish(ZDynBkMdl(x=60.0))
    >>> rclpy.spin_until_future_complete(mirror, odometry, timeout_sec=5.0)
    >>> round(odometry.result().pose.pose.position.z, 2)
    3.47
    >>> mirror.destroy_node()
    >>> rclpy.shutdown()
    """

    #: The topics that it subscribes to.
    inputs: ClassVar = {topics.STATE: ZDynBkMdl}

    def __init__(
        self,
        *,
        road: Road | None = None,
        track: Track | None = None,
        facts: Callable[[], RunDiagnostics] = RunDiagnostics,
        period: float = 1.0,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        """Mirror the states on `road` or `track`, by default those that the parameters name.

        `facts` returns what no topic carries. Paths and diagnostics are published every `period`
        [s] of wall-clock time.

        UserError: a parameter is out of range, or the road cannot be read.
        """
        super().__init__('mirror', **options)
        values = declare(self, PARAMETERS)
        track = declare_track(self, track)
        self._road = Road.flat() if track else road or Road.named(values['road'])
        self._map, self._base_link = frames(self)
        self._odom = self._base_link.replace('base_link', 'odom')
        self._last: ZDynBkMdl | None = None
        self._poses: deque[PoseStamped] = deque(maxlen=_MAX_POSES)
        self.latest = 0  #: [ns] the stamp of the newest state
        self._times: tuple[int, int] | None = None  # stamp and reception [ns] of the newest state
        self._last_times: tuple[int, int] | None = None  # the same at the last diagnosis
        self._facts, self._last_facts = facts, RunDiagnostics()
        self._period = period
        self._next_markers = self._next_path = 0.0

        self._odom_pub = self.create_publisher(Odometry, topics.ODOM, qos.DEFAULT)
        self._tf_pub = TFMessage and self.create_publisher(TFMessage, topics.TF, qos.DEFAULT)
        self._path_pub = self.create_publisher(Path, topics.PATH, qos.DEFAULT)
        self._car_pub = self.create_publisher(MarkerArray, topics.MARKERS, qos.DEFAULT)
        self._diagnostics_pub = self.create_publisher(
            DiagnosticArray, topics.DIAGNOSTICS, qos.DEFAULT
        )
        self._road_pub = self.create_publisher(MarkerArray, topics.ROAD_MARKERS, _LATCHED)
        if track:
            self._road_pub.publish(track_markers(track, self._odom))
            self._track_pub = self.create_publisher(Path, topics.TRACK_PATH, _LATCHED)
            header = to_header(0, self._odom)
            self._track_pub.publish(Path(header=header, **to_poses(header, track.lines()[2])))
        else:
            self._road_pub.publish(road_markers(self._road, self._odom))
        self.create_subscription(ZDynBkMdl, topics.STATE, self._on_state, qos.ALL)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(period, self._diagnose, clock=steady)

    def _on_state(self, state: ZDynBkMdl) -> None:
        self.latest = to_nanoseconds(state.header.stamp)
        if not all(map(isfinite, (state.x, state.y, state.psi, state.v_x, state.v_y))):
            return
        header = Header(stamp=state.header.stamp, frame_id=self._odom)
        pose = to_pose(state, self._road)
        self._times = self.latest, time.time_ns()
        self._extend_path(state, PoseStamped(header=header, pose=pose))
        odometry = Odometry(header=header, child_frame_id=self._base_link)
        odometry.pose.pose, twist = pose, odometry.twist.twist
        twist.linear.x, twist.linear.y = state.v_x, state.v_y
        twist.angular.z = state.psi_dot
        self._odom_pub.publish(odometry)
        if self._tf_pub:
            transform = TransformStamped(header=header, child_frame_id=self._base_link)
            p = pose.position
            transform.transform.translation = Vector3(x=p.x, y=p.y, z=p.z)
            transform.transform.rotation = pose.orientation
            origin = Header(stamp=state.header.stamp, frame_id=self._map)
            to_map = TransformStamped(header=origin, child_frame_id=self._odom)
            self._tf_pub.publish(TFMessage(transforms=[to_map, transform]))
        now = time.monotonic()
        if now >= self._next_markers:
            self._next_markers = now + _MARKERS_PERIOD
            self._car_pub.publish(car_markers(pose, header))
        if now >= self._next_path:
            self._next_path = now + self._period
            self._path_pub.publish(Path(header=header, poses=[*self._poses]))

    def _extend_path(self, state: ZDynBkMdl, pose: PoseStamped) -> None:
        """Add a pose unless it is close to the last one; start a new path after a reset."""
        if not (self._last and is_continuous(self._last, state)):
            self._poses.clear()
        self._last = state
        if self._poses:
            here, last = pose.pose.position, self._poses[-1].pose.position
            if hypot(here.x - last.x, here.y - last.y, here.z - last.z) < _SPACING:
                return
        self._poses.append(pose)

    def _diagnose(self) -> None:
        facts, before, now, factor = self._facts(), self._last_times, self._times, None
        if before and now:
            simulated, real = (new - old for new, old in zip(now, before, strict=True))
            factor = simulated / real if real else 0.0
        statuses = diagnose(facts, self._last_facts, factor)
        self._last_facts, self._last_times = facts, now
        for status in statuses:
            status.name = f'{self.get_fully_qualified_name()}: {status.name}'
        header = Header(stamp=self.get_clock().now().to_msg())
        self._diagnostics_pub.publish(DiagnosticArray(header=header, status=statuses))


def to_pose(state: ZDynBkMdl, road: Road) -> Pose:
    """Return the pose of `base_link` in `odom`; the state's `x` is along the road's surface.

    The orientation is a rotation by -theta about y, then by psi about the rotated z.
    """
    theta = radians(road.grade_deg(state.x))
    c_theta, s_theta = cos(theta / 2.0), sin(theta / 2.0)
    c_psi, s_psi = cos(state.psi / 2.0), sin(state.psi / 2.0)
    return Pose(
        position=Point(x=road.horizontal(state.x), y=state.y, z=road.elevation(state.x)),
        orientation=Quaternion(
            x=-s_theta * s_psi, y=-s_theta * c_psi, z=c_theta * s_psi, w=c_theta * c_psi
        ),
    )


def is_continuous(before: ZDynBkMdl, now: ZDynBkMdl) -> bool:
    """Return whether a car can move from one state to the next; if not, it was reset.

    The margin leaves room for measurement noise.
    """
    dt = (to_nanoseconds(now.header.stamp) - to_nanoseconds(before.header.stamp)) / NANOSECONDS
    fastest = max(map(abs, (before.v_x, now.v_x, before.v_y, now.v_y)))
    return dt > 0.0 and hypot(now.x - before.x, now.y - before.y) <= 2.0 * fastest * dt + 1.0


def car_markers(pose: Pose, header: Header) -> MarkerArray:
    """Return the car, a body with a cabin, at the pose of its `base_link`."""
    body = _marker(header, Marker.CUBE, (_LENGTH, 1.76, 0.9), _BLUE)
    cabin = _marker(header, Marker.CUBE, (0.48 * _LENGTH, 1.4, 0.44), _SKY)
    q = pose.orientation
    for marker, x, z in ((body, 0.0, 0.5), (cabin, -0.2, 1.1)):
        # The vector (x, 0, z) of the car, turned by the quaternion.
        marker.pose.position = Point(
            x=pose.position.x + x * (1 - 2 * (q.y**2 + q.z**2)) + 2 * z * (q.x * q.z + q.w * q.y),
            y=pose.position.y + 2 * x * (q.x * q.y + q.w * q.z) + 2 * z * (q.y * q.z - q.w * q.x),
            z=pose.position.z + 2 * x * (q.x * q.z - q.w * q.y) + z * (1 - 2 * (q.x**2 + q.y**2)),
        )
        marker.pose.orientation = q
    return _numbered('car', [body, cabin])


def road_markers(road: Road, frame: str) -> MarkerArray:
    """Return the road's surface, and its centre line."""
    starts, half = road.starts, _ROAD_WIDTH / 2.0
    ends = (min(starts[0], 0.0) - _MARGIN, *starts[1:], max(starts[-1], 0.0) + _MARGIN)
    places = [(road.horizontal(s), road.elevation(s)) for s in ends]
    left, right, middle = ([Point(x=x, y=y, z=z) for x, z in places] for y in (half, -half, 0.0))
    return _surface('road', frame, left, right, middle)


def track_markers(track: Track, frame: str) -> MarkerArray:
    """Return a track's surface, and its centre line."""
    lines = (to_poses(Header(), line)['poses'] for line in track.lines())
    return _surface('track', frame, *([each.pose.position for each in line] for line in lines))


def _surface(
    name: str, frame: str, left: list[Point], right: list[Point], middle: list[Point]
) -> MarkerArray:
    """Return markers of the surface between two edges, and of the line in the middle."""
    header = to_header(0, frame)
    surface = _marker(header, Marker.TRIANGLE_LIST, (1.0, 1.0, 1.0), _SURFACE)
    line = _marker(header, Marker.LINE_STRIP, (_LINE_WIDTH, 0.0, 0.0), _PAINT)
    quads = zip(pairwise(left), pairwise(right), strict=True)
    surface.points = [each for (a, b), (c, d) in quads for each in (c, d, a, a, d, b)]
    line.points = middle
    line.pose.position.z = 0.01
    return _numbered(name, [surface, line])


def _marker(header: Header, kind: int, size: Size, colour: Colour) -> Marker:
    red, green, blue = colour
    return Marker(
        header=header,
        type=kind,
        action=Marker.ADD,
        scale=Vector3(x=size[0], y=size[1], z=size[2]),
        color=ColorRGBA(r=red, g=green, b=blue, a=1.0),
    )


def _numbered(namespace: str, markers: list[Marker]) -> MarkerArray:
    for number, marker in enumerate(markers):
        marker.ns, marker.id = namespace, number
    return MarkerArray(markers=markers)


def diagnose(
    facts: RunDiagnostics, before: RunDiagnostics, factor: float | None = None
) -> list[DiagnosticStatus]:
    """Return the diagnostics since the last call, which had the facts `before`.

    `factor` is the real-time factor since then.
    """
    missed = (facts.missed or 0) - (before.missed or 0)
    slipped = (facts.slipped or 0) - (before.slipped or 0)
    level, message = _OK, 'in time'
    if missed > 0:
        level, message = _WARN, f'{missed} commands missed their deadline'
    elif slipped > 0:
        level, message = _WARN, f'simulated time has fallen behind by {slipped} periods'
    elif (lag := facts.stamp_lag or 0.0) > _MAX_STAMP_LAG:
        message = f'stamps are {lag:.1f} s behind the wall clock: reset, or use --clock'
        level = _WARN
    values = {
        'missed deadlines': facts.missed,
        'slipped periods': facts.slipped,
        'real-time factor': None if factor is None else f'{factor:.3f}',
        'behind the wall clock [s]': None if facts.stamp_lag is None else f'{facts.stamp_lag:.3f}',
    }
    statuses = [_status('timing', level, message, values)]
    if facts.recorded is not None:
        level, message = _OK, 'no lost message is counted'
        if facts.failure:
            level, message = _ERROR, facts.failure
        elif facts.lost:
            level, message = _WARN, f'{facts.lost} messages are lost'
        values = {'recorded messages': facts.recorded, 'lost messages': facts.lost}
        statuses.append(_status('bag', level, message, values))
    return statuses


def _status(
    name: str, level: bytes, message: str, values: Mapping[str, object]
) -> DiagnosticStatus:
    """Return a status with the values that are not None."""
    pairs = [KeyValue(key=key, value=str(each)) for key, each in values.items() if each is not None]
    return DiagnosticStatus(
        level=level, name=name, message=message, hardware_id='barc_sim', values=pairs
    )
