"""The node `mirror`: repeats the simulator's states in the messages of ROS's own tools."""

from __future__ import annotations

import time
from functools import partial
from math import isfinite
from typing import TYPE_CHECKING, Any

from barc_interfaces.msg import ECU, ZDynBkMdl
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import AccelStamped
from nav_msgs.msg import Odometry, Path
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from barc_sim.bags.cdr import NANOSECONDS
from barc_sim.nodes.mirrors.diagnosis import Facts, Measured, diagnose
from barc_sim.nodes.mirrors.kinds import MIRRORS
from barc_sim.nodes.mirrors.markers import CarMirror, to_road
from barc_sim.nodes.mirrors.messages import (
    acceleration_mirror,
    joint_mirror,
    odometry_mirror,
    to_diagnostics,
    to_path,
    transform_mirror,
)
from barc_sim.nodes.mirrors.ride import Ride, Trail
from barc_sim.ros import names
from barc_sim.ros.conversions import to_nanoseconds
from barc_sim.ros.executor import PolledCallbackGroup
from barc_sim.ros.parameters import declare
from barc_sim.ros.polled import polled, take
from barc_sim.vehicle.bike_model import Motion, Vehicle
from barc_sim.vehicle.parameters import Parameter
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.publisher import Publisher

    from barc_sim.nodes.mirrors.messages import Mirror

try:
    from tf2_msgs.msg import TFMessage
except ModuleNotFoundError:  # there is no wheel of it
    TFMessage = None

PARAMETERS = [
    *(Parameter(name, True, f'publish {what}', read_only=True) for name, what in MIRRORS.items()),
    Parameter('road', 'lab', "the simulator's road", read_only=True),
    *(
        Parameter(
            name,
            getattr(Vehicle(), name),
            f"the simulator's distance to the {axle} axle [m]",
            (0.01, 100.0),
            read_only=True,
        )
        for name, axle in (('l_f', 'front'), ('l_r', 'rear'))
    ),
]
#: [s] of wall-clock time between two pictures of the car: 25 a second, if states come at 50 Hz.
_PICTURE_PERIOD = 0.035
_DEPTH = 16  # of the queue of commands: only the newest counts
#: In lock-step the simulator goes on while a callback of another node lasts, or this thread rests.
_ALL_STATES = QoSProfile(depth=10_000, reliability=ReliabilityPolicy.RELIABLE)
_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class MirrorNode(Node):
    """Publishes each `z_vhcl` again in standard messages.

    They show the measured state on the road of the parameter `road`, the simulator's: `x` is the
    distance along its surface in `z_vhcl`, and the one on the map here. The wheels are steered as
    commanded. Frames are called `odom` and `base_link`; in the namespace `/car2`, `car2/odom` and
    `car2/base_link`.

    A mirror whose parameter is false has no publisher, and its topics are not subscribed to.

    Parameters
    ----------
    road
        Replaces the road that the parameter `road` names.
    facts
        Returns the facts that no topic carries; called at each diagnosis.
    period
        [s] of wall-clock time between two paths, and between two diagnoses.
    options
        Those of `rclpy.node.Node`.

    Raises
    ------
    UserError
        A parameter is out of range, or the road cannot be read.

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

    def __init__(
        self,
        *,
        road: Road | None = None,
        facts: Callable[[], Facts] = Facts,
        period: float = 1.0,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        super().__init__('mirror', **options)
        values = declare(self, PARAMETERS)
        on = {name for name in MIRRORS if values[name]}
        road = road or Road.named(values['road'])
        vehicle = Vehicle(l_f=values['l_f'], l_r=values['l_r'])
        self._prefix = f'{self.get_namespace().strip("/")}/'.lstrip('/')
        self._ride = Ride(road, vehicle)
        self._trail = Trail()
        self._car = CarMirror(self._prefix, vehicle)
        self._servo = 0.0
        self._state: tuple[int, int] | None = None  # stamp and reception [ns] of the newest
        self._last_state: tuple[int, int] | None = None  # those at the last diagnosis
        self._command_received: int | None = None  # [ns]
        self._facts, self._last_facts = facts, Facts()
        self._period = period
        self._next_picture = self._next_path = 0.0

        self._mirrors = self._state_mirrors(on)
        self._car_pub = self._path_pub = None
        if 'markers' in on:
            self._car_pub = self.create_publisher(MarkerArray, names.MARKERS, names.QOS)
            self._road_pub = self.create_publisher(MarkerArray, names.ROAD_MARKERS, _LATCHED)
            self._road_pub.publish(to_road(road, self._prefix))
        if 'path' in on:
            self._path_pub = self.create_publisher(Path, names.PATH, names.QOS)
        self._commands = None
        if on & {'markers', 'joint_states', 'diagnostics'}:
            self._commands = polled(self, ECU, names.ECU, _DEPTH, PolledCallbackGroup())
        self._states = None
        if on:
            self._states = self.create_subscription(
                ZDynBkMdl, names.STATE, self._on_state, _ALL_STATES
            )
        if 'diagnostics' in on:
            self._diagnostics_pub = self.create_publisher(
                DiagnosticArray, names.DIAGNOSTICS, names.QOS
            )
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self.create_timer(period, self._diagnose, clock=steady)

    def destroy_node(self) -> None:
        """Mirror the states that still wait, and end."""
        if self._states:
            for state, _ in take(self._states, _ALL_STATES.depth):
                self._on_state(state)
            self._states = None
        super().destroy_node()

    def _state_mirrors(self, on: set[str]) -> list[tuple[Publisher, Mirror]]:
        """Return the publishers of each state, each with the function that makes its message."""
        kinds: dict[str, tuple[type[Any], str, Callable[[str], Mirror]]] = {
            'odom': (Odometry, names.ODOM, odometry_mirror),
            'accel': (AccelStamped, names.ACCEL, acceleration_mirror),
            'joint_states': (JointState, names.JOINT_STATES, joint_mirror),
        }
        if TFMessage is not None:
            kinds['tf'] = (TFMessage, names.TF, partial(transform_mirror, kind=TFMessage))
        elif 'tf' in on:
            self.get_logger().info('no transforms are published: tf2_msgs is not installed')
        return [
            (self.create_publisher(kind, topic, names.QOS), mirror(self._prefix))
            for name, (kind, topic, mirror) in kinds.items()
            if name in on
        ]

    def _on_state(self, message: ZDynBkMdl) -> None:
        self._take_commands()
        motion = Motion(
            message.x, message.y, message.psi, message.v_x, message.v_y, message.psi_dot
        )
        if not all(map(isfinite, motion)):
            return
        stamp = to_nanoseconds(message.header.stamp)
        self._state = (stamp, time.time_ns())
        state = self._ride.update(stamp, motion, self._servo)
        self._trail.add(state)
        for pub, mirror in self._mirrors:
            pub.publish(mirror(state))
        now = time.monotonic()
        if self._car_pub and now >= self._next_picture:
            self._next_picture = now + _PICTURE_PERIOD
            self._car_pub.publish(self._car.of(state))
        if self._path_pub and now >= self._next_path:
            self._next_path = now + self._period
            self._path_pub.publish(to_path(self._trail.poses, self._prefix))

    def _take_commands(self) -> None:
        for command, info in take(self._commands, _DEPTH) if self._commands else ():
            self._command_received = info['received_timestamp']
            if isfinite(command.servo):
                self._servo = command.servo

    def _diagnose(self) -> None:
        self._take_commands()
        facts, age = self._facts(), None
        if self._command_received is not None:
            age = (time.time_ns() - self._command_received) / NANOSECONDS
        measured = Measured(factor=_ratio(self._last_state, self._state), command_age=age)
        diagnoses = diagnose(facts, self._last_facts, measured)
        self._last_facts, self._last_state = facts, self._state
        stamp = self.get_clock().now().nanoseconds
        name = self.get_fully_qualified_name()
        self._diagnostics_pub.publish(to_diagnostics(diagnoses, stamp, name))


def _ratio(before: tuple[int, int] | None, now: tuple[int, int] | None) -> float | None:
    """Return simulated seconds per second between two states, each with its reception."""
    if before is None or now is None:
        return None
    simulated, real = (new - old for new, old in zip(now, before, strict=True))
    return simulated / real if real else 0.0
