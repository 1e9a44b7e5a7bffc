"""The node `mirror`: tells what the simulator does in the messages of ROS's own tools."""

from __future__ import annotations

import sys
import time
from math import isfinite
from typing import TYPE_CHECKING, Any

from barc_interfaces.msg import ECU, ZDynBkMdl
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import AccelStamped
from nav_msgs.msg import Odometry, Path
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from barc_sim.cli.parser import call
from barc_sim.nodes.mirrors.diagnosis import Facts, Heard, diagnose
from barc_sim.nodes.mirrors.kinds import MIRRORS
from barc_sim.nodes.mirrors.markers import CarMirror, to_road
from barc_sim.nodes.mirrors.messages import (
    AccelerationMirror,
    JointMirror,
    OdometryMirror,
    TransformMirror,
    to_diagnostics,
    to_path,
)
from barc_sim.nodes.mirrors.ride import Ride, Trail
from barc_sim.ros import names
from barc_sim.ros.conversions import NANOSECONDS, to_nanoseconds
from barc_sim.ros.endpoints import publisher, subscription
from barc_sim.ros.executor.executor import QuickCallbackGroup
from barc_sim.ros.parameters import declare
from barc_sim.ros.polled import PolledCallbackGroup, polled, take
from barc_sim.ros.process import spin
from barc_sim.vehicle.bike_model import Motion, Vehicle
from barc_sim.vehicle.parameter import Parameter
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.publisher import Publisher

    from barc_sim.nodes.mirrors.ride import Seen

try:
    from tf2_msgs.msg import TFMessage
except ModuleNotFoundError:  # there is no wheel of it
    TFMessage = None

PARAMETERS = [
    *(Parameter(name, True, f'publish {what}', read_only=True) for name, what in MIRRORS.items()),
    Parameter('road', 'lab', "the simulator's road", read_only=True),
    Parameter(
        'l_f',
        Vehicle().l_f,
        "the simulator's, to the front axle [m]",
        (0.01, 100.0),
        read_only=True,
    ),
    Parameter(
        'l_r', Vehicle().l_r, "the simulator's, to the rear axle [m]", (0.01, 100.0), read_only=True
    ),
]
#: [s] by the wall clock, between two pictures of the car: 25 a second, if states come at 50 Hz.
_PICTURE_PERIOD = 0.035
#: [s] by the wall clock, between two messages of the way so far, and two diagnoses.
_SLOW_PERIOD = 1.0
_DEPTH = 16  # of commands that wait: the newest counts
_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class MirrorNode(Node):
    """Answers each `z_vhcl` with the same state in standard messages.

    They tell the measured state on the road of the parameter `road`, which is the simulator's:
    `x` runs along its surface there, and on the map here. The wheels are turned as commanded.
    Frames are called `odom` and `base_link`, in the namespace `/car2` `car2/odom` and
    `car2/base_link`.

    A mirror that a parameter turns off has no publisher; a topic that none needs is not heard.
    """

    def __init__(self, *, facts: Callable[[], Facts] = Facts, **options: Any) -> None:  # noqa: ANN401
        """Declare the parameters and publish what can't change.

        `facts` is asked once a second for what no topic tells.

        Raises
        ------
        UserError
            where a parameter is out of range, or the road can't be had.
        """
        super().__init__('mirror', **options)
        values = declare(self, PARAMETERS)
        on = {name for name in MIRRORS if values[name]}
        self._prefix = f'{self.get_namespace().strip("/")}/'.lstrip('/')
        road = Road.named(values['road'])
        vehicle = Vehicle(l_f=values['l_f'], l_r=values['l_r'])
        self._ride = Ride(road, vehicle)
        self._servo = 0.0
        self._state: tuple[int, int] | None = None
        self._mirrors = self._of_each_state(on)
        self._car: CarMirror | None = None
        self._trail: Trail | None = None
        self._next_picture = self._next_path = 0.0

        if 'markers' in on:
            self._car = CarMirror(self._prefix, vehicle)
            self._car_pub = publisher(self, MarkerArray, names.MARKERS)
            self._road_pub = self.create_publisher(MarkerArray, names.ROAD_MARKERS, _LATCHED)
            self._road_pub.publish(to_road(road, self._prefix))
        if 'path' in on:
            self._trail = Trail()
            self._path_pub = publisher(self, Path, names.PATH)
        group = QuickCallbackGroup()
        if 'diagnostics' in on:
            self._facts, self._facts_before = facts, Facts()
            self._state_before: tuple[int, int] | None = None
            self._command_at: int | None = None
            self._diagnostics_pub = publisher(self, DiagnosticArray, names.DIAGNOSTICS)
            wall = Clock(clock_type=ClockType.STEADY_TIME)
            self.create_timer(_SLOW_PERIOD, self._diagnose, group, wall)
        self._commands = None
        if on & {'markers', 'joint_states', 'diagnostics'}:
            self._commands = polled(self, ECU, names.ECU, _DEPTH, PolledCallbackGroup())
        if on:
            subscription(self, ZDynBkMdl, names.STATE, self._on_state, group)

    def _of_each_state(self, on: set[str]) -> list[tuple[Publisher, Callable[[Seen], Any]]]:
        """Return where to publish what of each state."""
        kinds: dict[str, tuple[type[Any], str, Callable[[], Any]]] = {
            'odom': (Odometry, names.ODOM, lambda: OdometryMirror(self._prefix)),
            'accel': (AccelStamped, names.ACCEL, lambda: AccelerationMirror(self._prefix)),
            'joint_states': (
                JointState,
                names.JOINT_STATES,
                lambda: JointMirror(self._prefix),
            ),
        }
        if TFMessage is None:
            if 'tf' in on:
                self.get_logger().info('no transforms are published: tf2_msgs is not installed')
        else:
            kinds['tf'] = (
                TFMessage,
                names.TF,
                lambda: TransformMirror(self._prefix, TFMessage),
            )
        return [
            (publisher(self, kind, topic), create().of)
            for name, (kind, topic, create) in kinds.items()
            if name in on
        ]

    def _on_state(self, state: ZDynBkMdl) -> None:
        self._hear_commands()
        stamp = to_nanoseconds(state.header.stamp)
        motion = Motion(state.x, state.y, state.psi, state.v_x, state.v_y, state.psi_dot)
        if not all(map(isfinite, motion)):
            return
        seen = self._ride.see(stamp, motion, self._servo)
        for pub, of in self._mirrors:
            pub.publish(of(seen))
        now = time.monotonic()
        self._state = (stamp, time.time_ns())
        if self._car and now >= self._next_picture:
            self._next_picture = now + _PICTURE_PERIOD
            self._car_pub.publish(self._car.of(seen))
        if self._trail:
            self._trail.follow(seen)
            if now >= self._next_path:
                self._next_path = now + _SLOW_PERIOD
                self._path_pub.publish(to_path(self._trail.poses, self._prefix))

    def _hear_commands(self) -> None:
        for command, info in take(self._commands, _DEPTH) if self._commands else ():
            self._command_at = info['received_timestamp']
            if isfinite(command.servo):
                self._servo = command.servo

    def _diagnose(self) -> None:
        self._hear_commands()
        facts, now = self._facts(), time.time_ns()
        heard = Heard(
            factor=_ratio(self._state_before, self._state),
            command_age=None
            if self._command_at is None
            else (now - self._command_at) / NANOSECONDS,
        )
        found = diagnose(facts, self._facts_before, heard)
        self._facts_before, self._state_before = facts, self._state
        stamp = self.get_clock().now().nanoseconds
        self._diagnostics_pub.publish(to_diagnostics(found, stamp, self.get_fully_qualified_name()))


def _ratio(before: tuple[int, int] | None, now: tuple[int, int] | None) -> float | None:
    """Return simulated seconds per second between two states, each with when it was heard."""
    if before is None or now is None:
        return None
    simulated, real = (new - old for new, old in zip(now, before, strict=True))
    return simulated / real if real else 0.0


def main(args: list[str] | None = None) -> int:
    """Run the node alone, until it is told to stop."""
    return call('mirror', lambda: spin(MirrorNode, args))


if __name__ == '__main__':
    sys.exit(main())
