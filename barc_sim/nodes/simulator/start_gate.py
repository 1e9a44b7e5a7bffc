"""When a simulator's time may begin: once somebody commands, and is as at the start."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from std_srvs.srv import Trigger

from barc_sim.ros import names
from barc_sim.ros.peers import is_own, living_publishers

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.callback_groups import CallbackGroup
    from rclpy.clock import Clock
    from rclpy.node import Node
    from rclpy.task import Future

#: [s]
_PERIOD = 0.01
#: Periods from seeing a controller to the first state. The controller sees this node a little
#: sooner or later than it is seen; a message that it is sent or sends meanwhile would be lost.
_COUNT = 10
#: The same where it is in another process: our recorder looks for it every 0.2 s.
_COUNT_APART = 40
#: [s] So long a node that commands is waited for to reset itself.
_RESET_TIMEOUT = 0.5


class Gate:
    """Looks for a publisher of `ecu`, and calls `begin` once there has been one for a while.

    The nodes that command reset themselves before: they may have driven another run.

    Parameters
    ----------
    node
        The simulator's.
    group
        Of its callbacks.
    clock
        The wall's.
    begin
        Lets time run.
    wait
        Whether for a publisher; if not, time may begin at once.
    """

    def __init__(
        self,
        node: Node,
        group: CallbackGroup,
        clock: Clock,
        begin: Callable[[], None],
        *,
        wait: bool,
    ) -> None:
        self._node = node
        self._begin = begin
        self._wait = wait
        self._resets = [
            node.create_client(Trigger, name, callback_group=group)
            for name in (names.RESET_CONTROLLER, names.RESET_RELAY)
        ]
        self._resetting: list[Future] = []
        self._patient_until = 0.0
        self._fresh = False
        self._ready_for, self._needed = 0, _COUNT
        self._timer = node.create_timer(_PERIOD, self._look, group, clock)

    def close(self) -> None:
        """Have the nodes that command reset themselves, and begin again after that."""
        ready = [reset for reset in self._resets if reset.service_is_ready()]
        self._resetting = [reset.call_async(Trigger.Request()) for reset in ready]
        self._patient_until = time.monotonic() + _RESET_TIMEOUT
        self._ready_for = min(self._ready_for, self._needed - 1)  # they know one another
        self._fresh = True
        self._timer.reset()

    def _look(self) -> None:
        if not all(future.done() for future in self._resetting):
            if time.monotonic() < self._patient_until:
                return
            self._node.get_logger().warning('a node that commands has not answered its reset')
        ends = living_publishers(self._node, names.ECU)
        self._needed = _COUNT if all(map(is_own, ends)) else _COUNT_APART
        self._ready_for = self._ready_for + 1 if ends or not self._wait else 0
        if self._ready_for < self._needed:
            return
        if not self._fresh:
            self.close()
            return
        self._timer.cancel()
        self._begin()
