"""What a simulator says of each state."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_interfaces.msg import Environment, EZDynBkMdl, ZDynBkMdl
from rosgraph_msgs.msg import Clock

from barc_sim.ros import names
from barc_sim.ros.conversions import to_environment, to_header, to_state, to_state_error
from barc_sim.ros.endpoints import publisher

if TYPE_CHECKING:
    from rclpy.node import Node

    from barc_sim.vehicle.plant import Observation


class StateOutlet:
    """Publishes states, the one that is to be answered last; and before each the time on `/clock`.

    Parameters
    ----------
    node
        The simulator's.
    clock
        Whether on `/clock`, too.
    """

    def __init__(self, node: Node, *, clock: bool) -> None:
        self._state_error_pub = publisher(node, EZDynBkMdl, names.STATE_ERROR)
        self._environment_pub = publisher(node, Environment, names.ENVIRONMENT)
        self._state_pub = publisher(node, ZDynBkMdl, names.STATE)
        # Reliable: who asks for the best effort hears it as well, and no bag lacks a tick.
        self._clock_pub = publisher(node, Clock, names.CLOCK) if clock else None
        self.topic = str(self._state_pub.topic_name)  #: of the states, by its full name
        self.keeps_clock = clock

    def publish(self, seen: Observation, stamp_ns: int) -> None:
        """Say what was `seen` at the time `stamp_ns` [ns]."""
        header = to_header(stamp_ns)
        self._now = header.stamp
        self.tell_time()
        self._environment_pub.publish(to_environment(seen, header))
        self._state = to_state_error(seen, header), to_state(seen, header)
        self.repeat()

    def repeat(self) -> None:
        """Say the latest state again, for who has come meanwhile and is to answer it."""
        error, state = self._state
        self._state_error_pub.publish(error)
        self._state_pub.publish(state)

    def tell_time(self) -> None:
        """Say the time of the latest state on `/clock`."""
        if self._clock_pub:
            self._clock_pub.publish(Clock(clock=self._now))
