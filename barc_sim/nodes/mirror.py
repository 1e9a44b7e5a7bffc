"""The node `mirror`: repeats the simulator's states in the messages of ROS's own tools.

Its frames are those of `barc_sim.ros.poses`.
"""

from __future__ import annotations

import time
from collections import deque
from math import hypot, isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_interfaces.msg import ZDynBkMdl
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped, TransformStamped, Vector3
from nav_msgs.msg import Odometry, Path
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from barc_sim.interfaces import qos, topics
from barc_sim.interfaces.parameters import ParameterDeclaration
from barc_sim.interfaces.stamps import NANOSECONDS, to_nanoseconds
from barc_sim.nodes.markers import car_markers, road_markers, track_markers
from barc_sim.ros.conversions import frames, to_header
from barc_sim.ros.parameters import declare, declare_track
from barc_sim.ros.poses import to_pose, to_poses
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from geometry_msgs.msg import Pose
    from rclpy.publisher import Publisher

    from barc_sim.vehicle.track import Track

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # PyPI has no wheel of it
    TFMessage = None

PARAMETERS = [ParameterDeclaration('road', 'lab', "the simulator's road", read_only=True)]
#: Minimum [s] of wall-clock time between two markers of the car: 25 a second for states at 50 Hz.
_MARKERS_PERIOD = 0.035
_MAX_POSES = 400  #: of the path
_SPACING = 0.5  #: [m] between two poses of the path
_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
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


class _Times(NamedTuple):
    """Times of a state."""

    stamp: int  #: [ns]
    received: int  #: [ns] since the epoch

    def factor_since(self, before: _Times) -> float:
        """Return the real-time factor since an earlier state."""
        passed = self.received - before.received
        return (self.stamp - before.stamp) / passed if passed else 0.0


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

        self.latest = 0  #: [ns] the stamp of the newest state
        self._last: ZDynBkMdl | None = None
        self._poses: deque[PoseStamped] = deque(maxlen=_MAX_POSES)
        self._period = period
        self._next_markers = 0.0  # [s] by the wall clock
        self._next_path = 0.0  # [s] by the wall clock
        self._facts = facts
        self._last_facts = RunDiagnostics()
        self._times: _Times | None = None  # of the newest state
        self._last_times: _Times | None = None  # the same at the last diagnosis

        self._create_publishers()
        self._publish_ground(track)

        self.create_subscription(ZDynBkMdl, topics.STATE, self._on_state, qos.EVERY_STATE)

        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(period, self._diagnose, clock=steady)

    def _create_publishers(self) -> None:
        self._odom_pub = self.create_publisher(Odometry, topics.ODOM, qos.DEFAULT)
        self._tf_pub: Publisher | None = None
        if TFMessage:
            self._tf_pub = self.create_publisher(TFMessage, topics.TF, qos.DEFAULT)
        self._path_pub = self.create_publisher(Path, topics.PATH, qos.DEFAULT)
        self._car_pub = self.create_publisher(MarkerArray, topics.MARKERS, qos.DEFAULT)
        self._diagnostics_pub = self.create_publisher(
            DiagnosticArray, topics.DIAGNOSTICS, qos.DEFAULT
        )
        self._ground_pub = self.create_publisher(MarkerArray, topics.ROAD_MARKERS, _LATCHED)

    def _publish_ground(self, track: Track | None) -> None:
        """Publish the road, or the track and its centre line, once for all subscriptions."""
        if track is None:
            self._ground_pub.publish(road_markers(self._road, self._odom))
            return

        self._ground_pub.publish(track_markers(track, self._odom))
        _, _, middle = track.lines()
        header = to_header(0, self._odom)
        self._track_pub = self.create_publisher(Path, topics.TRACK_PATH, _LATCHED)
        self._track_pub.publish(Path(header=header, **to_poses(header, middle)))

    def _on_state(self, state: ZDynBkMdl) -> None:
        self.latest = to_nanoseconds(state.header.stamp)
        if not all(map(isfinite, (state.x, state.y, state.psi, state.v_x, state.v_y))):
            return
        self._times = _Times(self.latest, time.time_ns())

        header = Header(stamp=state.header.stamp, frame_id=self._odom)
        pose = to_pose(state, self._road)
        self._odom_pub.publish(self._odometry(header, pose, state))
        if self._tf_pub:
            self._tf_pub.publish(self._transforms(header, pose))

        self._extend_path(state, PoseStamped(header=header, pose=pose))
        now = time.monotonic()
        if now >= self._next_markers:
            self._next_markers = now + _MARKERS_PERIOD
            self._car_pub.publish(car_markers(pose, header))
        if now >= self._next_path:
            self._next_path = now + self._period
            self._path_pub.publish(Path(header=header, poses=[*self._poses]))

    def _odometry(self, header: Header, pose: Pose, state: ZDynBkMdl) -> Odometry:
        odometry = Odometry(header=header, child_frame_id=self._base_link)
        odometry.pose.pose = pose
        twist = odometry.twist.twist
        twist.linear.x = state.v_x
        twist.linear.y = state.v_y
        twist.angular.z = state.psi_dot
        return odometry

    def _transforms(self, header: Header, pose: Pose) -> TFMessage:
        """Return the transforms from `map` to `odom`, which are equal, and on to `base_link`."""
        on_map = Header(stamp=header.stamp, frame_id=self._map)
        to_odom = TransformStamped(header=on_map, child_frame_id=self._odom)

        to_car = TransformStamped(header=header, child_frame_id=self._base_link)
        place = pose.position
        to_car.transform.translation = Vector3(x=place.x, y=place.y, z=place.z)
        to_car.transform.rotation = pose.orientation
        return TFMessage(transforms=[to_odom, to_car])

    def _extend_path(self, state: ZDynBkMdl, pose: PoseStamped) -> None:
        """Add a pose unless it is close to the last one; start a new path after a reset."""
        if not (self._last and is_continuous(self._last, state)):
            self._poses.clear()
        self._last = state
        if self._poses:
            here = pose.pose.position
            last = self._poses[-1].pose.position
            if hypot(here.x - last.x, here.y - last.y, here.z - last.z) < _SPACING:
                return
        self._poses.append(pose)

    def _diagnose(self) -> None:
        facts = self._facts()
        times = self._times
        factor = None
        if times and self._last_times:
            factor = times.factor_since(self._last_times)
        statuses = diagnose(facts, self._last_facts, factor)
        self._last_facts = facts
        self._last_times = times

        for status in statuses:
            status.name = f'{self.get_fully_qualified_name()}: {status.name}'
        header = Header(stamp=self.get_clock().now().to_msg())
        self._diagnostics_pub.publish(DiagnosticArray(header=header, status=statuses))


def is_continuous(before: ZDynBkMdl, now: ZDynBkMdl) -> bool:
    """Return whether a car can move from one state to the next; if not, it was reset.

    The margin leaves room for measurement noise.
    """
    dt = (to_nanoseconds(now.header.stamp) - to_nanoseconds(before.header.stamp)) / NANOSECONDS
    moved = hypot(now.x - before.x, now.y - before.y)
    fastest = max(map(abs, (before.v_x, now.v_x, before.v_y, now.v_y)))
    return dt > 0.0 and moved <= 2.0 * fastest * dt + 1.0


def diagnose(
    facts: RunDiagnostics, before: RunDiagnostics, factor: float | None = None
) -> list[DiagnosticStatus]:
    """Return the diagnostics since the last call, which had the facts `before`.

    `factor` is the real-time factor since then.
    """
    statuses = [_timing(facts, before, factor)]
    if facts.recorded is not None:
        statuses.append(_bag(facts))
    return statuses


def _timing(
    facts: RunDiagnostics, before: RunDiagnostics, factor: float | None
) -> DiagnosticStatus:
    missed = (facts.missed or 0) - (before.missed or 0)
    slipped = (facts.slipped or 0) - (before.slipped or 0)
    lag = facts.stamp_lag or 0.0

    level = DiagnosticStatus.WARN
    if missed > 0:
        message = f'{missed} commands missed their deadline'
    elif slipped > 0:
        message = f'simulated time has fallen behind by {slipped} periods'
    elif lag > _MAX_STAMP_LAG:
        message = f'stamps are {lag:.1f} s behind the wall clock: reset, or use --clock'
    else:
        level = DiagnosticStatus.OK
        message = 'in time'

    values = {
        'missed deadlines': facts.missed,
        'slipped periods': facts.slipped,
        'real-time factor': None if factor is None else f'{factor:.3f}',
        'behind the wall clock [s]': None if facts.stamp_lag is None else f'{facts.stamp_lag:.3f}',
    }
    return _status('timing', level, message, values)


def _bag(facts: RunDiagnostics) -> DiagnosticStatus:
    level = DiagnosticStatus.OK
    message = 'no lost message is counted'
    if facts.failure:
        level = DiagnosticStatus.ERROR
        message = facts.failure
    elif facts.lost:
        level = DiagnosticStatus.WARN
        message = f'{facts.lost} messages are lost'
    values = {'recorded messages': facts.recorded, 'lost messages': facts.lost}
    return _status('bag', level, message, values)


def _status(
    name: str, level: bytes, message: str, values: Mapping[str, object]
) -> DiagnosticStatus:
    """Return a status with the values that are not None."""
    pairs = [KeyValue(key=key, value=str(each)) for key, each in values.items() if each is not None]
    return DiagnosticStatus(
        level=level, name=name, message=message, hardware_id='barc_sim', values=pairs
    )
