"""Callback groups by which a node chooses how its callbacks are executed."""

from __future__ import annotations

from threading import Lock
from typing import TYPE_CHECKING

from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup

if TYPE_CHECKING:
    from barc_sim.ros.executor.entities import Entity


class QuickCallbackGroup(MutuallyExclusiveCallbackGroup):
    """Callbacks that a `QuickExecutor` runs at once, in the thread that spins.

    Such a callback must never block or sleep, wait for a future or for another callback, or
    compute for long: until it returns, nothing else begins. In return it costs no hand-off to
    another thread. For any other executor the group is an ordinary mutually exclusive one.

    Examples
    --------
    >>> import rclpy
    >>> from barc_sim.ros.executor import QuickExecutor
    >>> rclpy.init()
    >>> node, executor = rclpy.create_node('clockwork'), QuickExecutor()
    >>> timer = node.create_timer(0.01, lambda: print('tick'), QuickCallbackGroup())
    >>> executor.add_node(node)
    True
    >>> executor.spin_once(timeout_sec=1.0)
    tick
    >>> executor.shutdown()
    True
    """

    def __init__(self) -> None:
        super().__init__()
        self.claimed = Lock()

    def can_execute(self, entity: Entity) -> bool:  # noqa: ARG002 (rclpy's)
        """Return whether none of the callbacks runs."""
        return not self.claimed.locked()

    def beginning_execution(self, entity: Entity) -> bool:  # noqa: ARG002
        """Claim the group; return False where it is claimed already."""
        return self.claimed.acquire(blocking=False)

    def ending_execution(self, entity: Entity) -> None:  # noqa: ARG002
        """Give the group back."""
        self.claimed.release()


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
