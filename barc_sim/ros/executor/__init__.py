"""An executor on events: DDS counts arrivals, and epoll waits for them.

`QuickExecutor` is a `MultiThreadedExecutor` by type and by its promises. Nothing here changes
rclpy's classes, or the process's limits.

The way of a message
--------------------
1. DDS calls the listener of the subscription. The listener is libc's `eventfd_write`, which adds 1
   to an eventfd: no code of Python runs (`rcl.py`).
2. epoll returns the descriptor to the thread that polls (`linux.py`). Its entry joins the end of
   the queue of entries with arrivals (`events.py`).
3. When its turn comes, the thread claims the callback group (`entities.py`), takes one message
   (`takes.py`), and calls the callback itself (`executor.py`). An entry with more messages joins
   the end of the queue again.

Timers have no listener: the wait ends when the next one is due. Python writes one more eventfd at
each trigger of a guard condition, and when a task or a spin changes (`tasks.py`, `spins.py`).
Entities without a listener, such as actions, are left to rclpy's wait set (`wait_set.py`).

Threads
-------
==========  ====================================  ==============================================
thread      what it does                          when it waits
==========  ====================================  ==============================================
leader      polls, takes, calls; one at a time    in epoll, when nothing is ready
callback    runs a callback that lasts            as the callback does; then it stands by
stand-by    takes the lead from such a callback   for a timer, which each short callback puts off
spinning    has called `spin` or the like         until its spin is over
wait set    waits for entities without listener   in rclpy's wait set; only if there are any
DDS's own   deliver messages, and count them      -
==========  ====================================  ==============================================

The leader, the callbacks and the stand-by are the `num_threads` threads of the pool. A callback
runs in the thread that polled, because to hand it to another would cost more than most callbacks
take. So the leader lends its lead for each call. If the call returns soon, the thread takes the
lead back, without a lock and without a system call. If it lasts, the stand-by leads from then on,
and another thread stands by (`leadership.py`).

States
------
Four tables name each state and what changes it: of an entity's arrivals (`Events`), of a task
(`Tasks`), of a spin (`Spin`) and of the lead (`Leadership`).
"""

import warnings
from typing import TYPE_CHECKING

from rclpy.executors import MultiThreadedExecutor

from barc_sim.ros.executor.support import unsupported

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
