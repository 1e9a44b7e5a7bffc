"""The executor of every run, on events: DDS counts arrivals, and epoll waits for them.

Nothing here changes rclpy's classes, or the process's limits.
"""

import warnings
from typing import TYPE_CHECKING

from rclpy.executors import MultiThreadedExecutor

from barc_sim.ros.executor.rclpy_private import unsupported

__all__ = ['QuickExecutor']

if TYPE_CHECKING or not (_reason := unsupported()):
    from barc_sim.ros.executor.executor import QuickExecutor
else:
    warnings.warn(
        f'QuickExecutor is a plain MultiThreadedExecutor here: {_reason}; '
        "use Jazzy's rclpy, 7.1.5 or later, on Linux, for a fast one",
        stacklevel=2,
    )
    QuickExecutor = MultiThreadedExecutor
