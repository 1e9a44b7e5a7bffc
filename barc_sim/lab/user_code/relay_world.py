"""The world around a relay's program: a driver and a car, in simulated time, without ROS."""

from __future__ import annotations

import threading
import time
from math import isfinite
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from barc_sim.lab.user_code import rospy
from barc_sim.ros.local import find_module
from barc_sim.ros.local import world as in_world
from barc_sim.ros.local.context import Context, HistoryPolicy, QoSProfile
from barc_sim.ros.local.executor import SECOND, EndOfTimeError, Executor, World
from barc_sim.ros.local.messages import message_type
from barc_sim.ros.local.node import Node

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

CMD_VEL, STATE, COMMANDS = _TOPICS = 'cmd_vel', 'z_vhcl', 'ecu'
_STATE_PERIOD = 0.02  #: [s]
_ALL = QoSProfile(history=HistoryPolicy.KEEP_ALL)


def load() -> None:
    """Make all that a program may import, before its process is confined."""
    find_module('rclpy')


class _Modules(dict[str, Any]):
    """The modules of a program: those here, and what stands in for ROS 2."""

    def get(self, name: str, default: Any = None) -> Any:  # noqa: ANN401 (a module)
        return self[name] if name in self else find_module(name) or default


class RelayWorld(World):
    """The driver and the car around a program, from time 0 to `end` [s].

    Its topics have no namespaces: the lab's keyboard has `turtle1/cmd_vel`.
    """

    def __init__(self, twists: Sequence[tuple[float, float, float]], end: float) -> None:
        super().__init__(simulated=True, end=end, flat_names=_TOPICS, silent=True)
        self.commands: list[tuple[float, float, float]] = []  #: t [s], motor and servo
        self.published: set[str] = set()  #: the program's topics
        self.subscribed: set[str] = set()
        self._speed = self._distance = self._motor = self._moved = 0.0
        with in_world(self):
            context = Context()
            context.init([])
            self.node = Node('car', context=context, enable_rosout=False)
            self._twist_pub = self.node.create_publisher(
                message_type('geometry_msgs/msg/Twist'), CMD_VEL, _ALL
            )
            state = message_type('barc_interfaces/msg/ZDynBkMdl')
            self._state, self._state_pub = (
                state(),
                self.node.create_publisher(state, STATE, _ALL),
            )
            ecu = message_type('barc_interfaces/msg/ECU')
            self.node.create_subscription(ecu, COMMANDS, self._on_command, _ALL)
            for t, linear_x, angular_z in twists:
                self._drive_at(t, linear_x, angular_z)
            self._publish_state()
            self.node.create_timer(_STATE_PERIOD, self._publish_state)
            self._executor = Executor(context=context)
            self._executor.add_node(self.node)
        self.around.append(self._executor)

    def _drive_at(self, t: float, linear_x: float, angular_z: float) -> None:
        def publish() -> None:
            timer.cancel()
            self.drive(linear_x, angular_z)

        timer = self.node.create_timer(t, publish)

    def drive(self, linear_x: float, angular_z: float) -> None:
        """Publish a Twist."""
        message = message_type('geometry_msgs/msg/Twist')()
        message.linear.x, message.angular.z = float(linear_x), float(angular_z)
        self._twist_pub.publish(message)

    def _on_command(self, command: Any, info: dict[str, int]) -> None:  # noqa: ANN401 (an ECU)
        self._move()
        self._motor = command.motor if isfinite(command.motor) else 0.0
        t = info['received_timestamp'] / SECOND
        self.commands.append((t, command.motor, command.servo))

    def _move(self) -> None:
        now = self.now_ns / SECOND
        self._distance += self._speed * (now - self._moved)
        self._speed += self._motor * (now - self._moved)
        self._moved = now

    def _publish_state(self) -> None:
        self.look()
        self._move()
        self._state.x, self._state.v_x = self._distance, self._speed
        self._state_pub.publish(self._state)

    def look(self) -> None:
        """Note the topics of the program's nodes."""
        for node in self.node.context.nodes:
            if node is not self.node:
                self.published |= {each.full_name.strip('/') for each in node.publishers}
                self.subscribed |= {each.full_name.strip('/') for each in node.subscriptions}

    @property
    def seconds(self) -> float:
        """The time [s]."""
        return self.now_ns / SECOND

    def has_nodes(self) -> bool:
        """Return whether the program has made a node."""
        return len(self.node.context.nodes) > 1

    def modules(self, *, ros_1: bool) -> dict[str, Any]:
        """Return the modules of a program, which replace those of their names."""
        clock = {
            **dict.fromkeys(('time', 'monotonic', 'perf_counter'), lambda: self.seconds),
            **dict.fromkeys(('time_ns', 'monotonic_ns'), lambda: self.now_ns),
            'sleep': lambda seconds: self.sleep(round(max(float(seconds), 0.0) * SECOND)),
        }
        found = _Modules(time=SimpleNamespace(**vars(time) | clock))
        if ros_1:
            with in_world(self):
                found.update(rospy.modules(self))
        return found

    def run(self, program: Callable[[], object]) -> None:
        """Run a program to its end, or to that of its time."""
        try:
            with in_world(self):
                program()
        except (EndOfTimeError, SystemExit):
            pass
        self.look()
        self.published -= {'rosout', 'parameter_events', COMMANDS}
        while self._executor.next_due() == self.now_ns:
            self._executor.turn(self.now_ns)


class LiveWorld(RelayWorld):
    """A world whose time continues when the driver asks for the next command."""

    def __init__(self) -> None:
        super().__init__((), 0.0)
        self.more, self.waits = threading.Semaphore(0), threading.Semaphore(0)

    def at_end(self) -> None:
        """Wait for the driver."""
        self.waits.release()
        self.more.acquire()

    def continue_for(self, seconds: float) -> None:
        """Let the program run for so long."""
        self.end += seconds * SECOND
        self.more.release()
