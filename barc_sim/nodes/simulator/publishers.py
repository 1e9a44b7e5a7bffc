"""The publishers of a simulator: the state, its error, the environment, and the clock."""

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


class StatePublishers:
    """Publishes each state on its topics: `/clock` first, and `z_vhcl`, to be answered, last.

    Attributes
    ----------
    topic
        The full name of the states' topic.
    keeps_clock
        Whether `/clock` is published.
    """

    def __init__(self, node: Node, *, clock: bool) -> None:
        """Create the publishers of `node`, with `/clock` if `clock` is true."""
        self._state_error_pub = publisher(node, EZDynBkMdl, names.STATE_ERROR)
        self._environment_pub = publisher(node, Environment, names.ENVIRONMENT)
        self._state_pub = publisher(node, ZDynBkMdl, names.STATE)
        # Reliable, so that no bag lacks a tick; best-effort subscriptions receive it as well.
        self._clock_pub = publisher(node, Clock, names.CLOCK) if clock else None
        self.topic = str(self._state_pub.topic_name)
        self.keeps_clock = clock

    def publish(self, seen: Observation, stamp_ns: int) -> None:
        """Publish what was observed at the time `stamp_ns` [ns]."""
        header = to_header(stamp_ns)
        self._now = header.stamp
        self.publish_clock()
        self._environment_pub.publish(to_environment(seen, header))
        self._state = to_state_error(seen, header), to_state(seen, header)
        self.republish()

    def republish(self) -> None:
        """Publish the latest state again, for a controller that has started since."""
        error, state = self._state
        self._state_error_pub.publish(error)
        self._state_pub.publish(state)

    def publish_clock(self) -> None:
        """Publish the time of the latest state on `/clock`."""
        if self._clock_pub:
            self._clock_pub.publish(Clock(clock=self._now))
