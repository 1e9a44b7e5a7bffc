"""The executor of every run, on events: DDS counts what arrives, and epoll waits for it.

What executes callbacks lives here; what a callback does lives in the nodes.
"""

from barc_sim.ros.executor.callback_groups import PolledCallbackGroup, QuickCallbackGroup
from barc_sim.ros.executor.executor import QuickExecutor

__all__ = ['PolledCallbackGroup', 'QuickCallbackGroup', 'QuickExecutor']
