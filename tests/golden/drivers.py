"""Drivers of a run from outside, with rclpy and the messages alone."""

from __future__ import annotations

import signal
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

from barc_interfaces.msg import ECU, ZDynBkMdl
from geometry_msgs.msg import Twist
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Iterator

#: [s] A run that takes longer has failed.
TIMEOUT = 100.0
_DEPTH = 100
#: States for which a run by hand goes on, at least, once the car moves.
_STATES_BY_HAND = 200


class Steering:
    """Answers each state with a command that depends on the number of the state alone."""

    def __init__(self, node: Node) -> None:
        """Subscribe to the states; commands are published once their publisher is found.

        The simulator starts when it finds a publisher of commands: by then it knows this
        subscription.
        """
        self._node = node
        self._publisher = None
        self._stamps: list[tuple[int, int]] = []
        self._states = node.create_subscription(ZDynBkMdl, 'z_vhcl', self._answer, _DEPTH)

    def spin(self, _: subprocess.Popen[str]) -> None:
        """Begin to command when there is somebody to command."""
        if not self._publisher and self._node.count_publishers('z_vhcl'):
            self._publisher = self._node.create_publisher(ECU, 'ecu', _DEPTH)

    def _answer(self, state: ZDynBkMdl) -> None:
        stamp = (state.header.stamp.sec, state.header.stamp.nanosec)
        if stamp not in self._stamps[-1:]:
            self._stamps.append(stamp)
        motor, servo = command(len(self._stamps) - 1)
        assert self._publisher
        self._publisher.publish(ECU(header=state.header, motor=motor, servo=servo))


def command(k: int) -> tuple[float, float]:
    """Return the acceleration [m/s²] and the steering [rad] for state `k`, by exact arithmetic."""
    motor = 3.0 if k < 120 or k % 250 > 150 else -0.75
    # A triangle between -0.15625 and 0.15625 rad, once in 160 steps, then straight, then a jump.
    servo = (abs((k + 40) % 160 - 80) - 40) / 256
    return motor, (0.0, -0.25)[k % 2] if 300 <= k < 310 else servo


class Throttle:
    """Publishes full throttle until the car has moved for a while, and then ends the run."""

    def __init__(self, node: Node) -> None:
        """Publish from the start."""
        self._moving = 0
        self._states = node.create_subscription(ZDynBkMdl, 'z_vhcl', self._note, _DEPTH)
        self._publisher = node.create_publisher(Twist, 'cmd_vel', _DEPTH)
        twist = Twist()
        twist.linear.x = 1.0
        self._timer = node.create_timer(0.05, lambda: self._publisher.publish(twist))

    def spin(self, process: subprocess.Popen[str]) -> None:
        """End the run once the car has moved for a while."""
        if self._moving > _STATES_BY_HAND:
            process.send_signal(signal.SIGINT)
            self._moving = 0

    def _note(self, state: ZDynBkMdl) -> None:
        self._moving += state.v_x > 0.0


_DRIVERS = {'steering': Steering, 'throttle': Throttle}


@contextmanager
def _executor() -> Iterator[tuple[SingleThreadedExecutor, Node]]:
    context = Context()
    context.init()
    try:
        node = Node('driver', context=context, enable_rosout=False, start_parameter_services=False)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        yield executor, node
        executor.shutdown()
        node.destroy_node()
    finally:
        context.try_shutdown()


def drive(name: str, process: subprocess.Popen[str]) -> None:
    """DriverInput until the run in `process` has ended."""
    with _executor() as (executor, node):
        driver = _DRIVERS[name](node)
        deadline = time.monotonic() + TIMEOUT
        while process.poll() is None and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.02)
            driver.spin(process)
