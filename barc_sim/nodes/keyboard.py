"""The node `keyboard`: publishes the driver's input from the terminal's keys, as `cmd_vel`."""

from __future__ import annotations

import time
from collections import deque
from typing import Any

from geometry_msgs.msg import Twist
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from barc_sim.control.driver import FULL_BRAKE, RATE
from barc_sim.control.keyboard import HeldKeys, Terminal
from barc_sim.interfaces import qos, services, topics
from barc_sim.ros.conversions import to_twist


class Keyboard(Node):
    """Publishes `cmd_vel` while a key is held, zero once after its release, and then nothing.

    Destroying the node brakes. `finished` is done when the user presses `q` or Ctrl-C.
    """

    def __init__(self, terminal: Terminal | None = None, **options: Any) -> None:  # noqa: ANN401
        """Read keys from `terminal`, by default the standard input; it is closed at the end."""
        super().__init__('keyboard', **options)

        self._terminal = terminal or Terminal()
        self._keys = HeldKeys()
        self._pressed: deque[tuple[str, float]] = deque()
        self.finished = Future()
        # Restores the terminal before anything else ends, in whichever thread `finished` is set.
        self.finished.add_done_callback(lambda _: self._terminal.close())

        self._twist_pub = self.create_publisher(Twist, topics.CMD_VEL, qos.DEFAULT)
        self._reset = self.create_client(Trigger, services.RESET_SIMULATOR)

        self._typed = self.create_guard_condition(self._on_typed)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self.create_timer(1.0 / RATE, self._publish, clock=steady)
        self._terminal.listen(self._on_key)

    def destroy_node(self) -> None:
        """Restore the terminal, brake, and destroy the node."""
        self._terminal.close()
        if self.context.ok() and self._twist_pub in self.publishers:
            self._twist_pub.publish(to_twist(FULL_BRAKE))
            # The process may end next, which would discard an undelivered message.
            self._twist_pub.wait_for_all_acked(Duration(seconds=0.3))
        super().destroy_node()

    def _on_key(self, key: str) -> None:
        """Pass a key from the terminal's thread to the thread that spins the node."""
        if key == 'quit':
            self.finished.set_result(None)
        else:
            self._pressed.append((key, time.monotonic()))
            self._typed.trigger()

    def _on_typed(self) -> None:
        while self._pressed:
            key, t = self._pressed.popleft()
            is_new = self._keys.handle(key, t)
            if is_new and key == 'reset':
                self._request_reset()
        self._publish()
        self._timer.reset()

    def _request_reset(self) -> None:
        if self._reset.service_is_ready():
            self._reset.call_async(Trigger.Request())
        else:
            self.get_logger().warning('there is no simulator to reset')

    def _publish(self) -> None:
        request = self._keys.request(time.monotonic())
        if request is not None:
            self._twist_pub.publish(to_twist(request))
