"""Callback groups by which a node chooses how its callbacks are executed."""

from __future__ import annotations

from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup

#: The default group's type. Every group's callbacks run in the thread that polled.
QuickCallbackGroup = MutuallyExclusiveCallbackGroup


class PolledCallbackGroup(CallbackGroup):
    """Keeps its subscriptions out of every executor's wait set.

    Waking up for each message would cost 4 % of a core at 50 Hz with 7 topics; polling all of them
    every 50 ms costs about 1 %, and nothing runs between a state and the command that answers it.
    DDS stamps the time of reception, so polling late loses nothing.

    Examples
    --------
    >>> import rclpy
    >>> from std_msgs.msg import Float64
    >>> rclpy.init()
    >>> node = rclpy.create_node('logger')
    >>> speeds = node.create_subscription(
    ...     Float64, 'speed', print, 1, callback_group=PolledCallbackGroup()
    ... )
    >>> node.create_publisher(Float64, 'speed', 1).publish(Float64(data=8.0))
    >>> rclpy.spin_once(node, timeout_sec=0.01)
    >>> speeds.handle.take_message(Float64, False)[0].data
    8.0
    """

    def can_execute(self, entity: object) -> bool:  # noqa: ARG002 (rclpy's)
        """Never."""
        return False

    def beginning_execution(self, entity: object) -> bool:  # noqa: ARG002 (rclpy's)
        """Never."""
        return False

    def ending_execution(self, entity: object) -> None:
        """Do nothing, as nothing begins."""
