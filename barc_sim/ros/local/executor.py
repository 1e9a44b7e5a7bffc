"""Timers, futures and executors, in one thread.

An arrival puts its receiver into the queue of the executor that has the receiver's node. The
executor calls callbacks in the order of arrival.
"""

from __future__ import annotations

import inspect
import threading
import time
from collections import deque
from math import inf
from typing import TYPE_CHECKING, Any

from barc_sim.ros.local.messages import LACKS
from barc_sim.ros.local.world import SECOND, current

if TYPE_CHECKING:
    from collections.abc import Callable

_LONGEST_SLEEP = 0.1  #: [s] until an executor notices that another thread has shut down rclpy


class ExternalShutdownException(Exception):
    """rclpy has been shut down while an executor waited."""


def not_async(callback: Any) -> Any:
    """Return a callback; TypeError: it is a coroutine function."""
    if inspect.iscoroutinefunction(callback):
        raise TypeError(f'an async callback {LACKS}')
    return callback


class Timer:
    """A timer of wall-clock or simulated time; when late, it skips the periods that have passed.

    Parameters
    ----------
    node
        The node whose timer it is.
    period
        From one call to the next [ns].
    callback
        Called without arguments.
    """

    queue = None  #: a timer receives no messages

    def __init__(self, node: Any, period: int, callback: Any) -> None:
        self.node = node
        self.callback = not_async(callback)
        self.timer_period_ns = period
        self.due = inf  #: [ns]; infinity: it is cancelled
        self._now = node.context.now

    def _set(self, due: float) -> None:
        self.due = due
        if self.node.executor is not None:
            self.node.executor.check_timers(due)

    def run(self) -> None:
        """Call the callback, unless the timer was reset or cancelled meanwhile."""
        now = self._now()
        if now < self.due:
            return

        period = self.timer_period_ns
        due = now
        if period:
            late_periods = (now - self.due) // period
            due = self.due + period * (1 + late_periods)
        self._set(due)
        self.callback()

    def reset(self) -> None:
        """Begin a period now."""
        self._set(self._now() + self.timer_period_ns)

    def cancel(self) -> None:
        """Call the callback no more, until `reset`."""
        self.due = inf

    destroy = cancel

    def is_canceled(self) -> bool:
        """Return whether it is cancelled."""
        return self.due == inf


class Future:
    """The result of a task, such as the response to a request, which is there later."""

    _result: Any = None
    is_done = False

    def __init__(self) -> None:
        self._callbacks: list[Callable[[Future], object]] = []

    def done(self) -> bool:
        """Return whether there is a result."""
        return self.is_done

    def result(self) -> Any:
        """Return the result; None: there is none yet."""
        return self._result

    def set_result(self, result: Any) -> None:
        """Set the result, and call the callbacks in this thread."""
        self._result = result
        self.is_done = True
        while self._callbacks:
            self._callbacks.pop(0)(self)

    def add_done_callback(self, callback: Callable[[Future], object]) -> None:
        """Call a callback with this future once there is a result; at once if there is one."""
        if self.is_done:
            callback(self)
        else:
            self._callbacks.append(callback)


class Executor:
    """Calls callbacks in one thread, in the order of arrival.

    Parameters
    ----------
    num_threads
        As in rclpy, but without effect.

    Attributes
    ----------
    ready
        The entities with an arrival and the timers that are due, one for each call.
    waits
        Whether the thread that spins waits for `awake`, which another thread can set.
    """

    def __init__(self, num_threads: int | None = None) -> None:
        del num_threads
        self.world = current()
        self._nodes: list[Any] = []
        self.ready: deque[Any] = deque()
        self._soonest: float = 0  #: [ns] No timer is due before this time.
        self._is_shutdown = False
        self.waits = False
        self.awake = threading.Event()

    def __enter__(self) -> Executor:  # noqa: PYI034 (Self is newer than Python 3.10)
        return self

    def __exit__(self, *_: object) -> None:
        self.shutdown()

    def add_node(self, node: Any) -> bool:
        """Take a node from its present executor.

        Parameters
        ----------
        node
            The node.

        Returns
        -------
        bool
            False if it is in this executor already.
        """
        if node in self._nodes:
            return False
        if node.executor is not None:
            node.executor.remove_node(node)
        self._nodes.append(node)
        node.executor = self
        self.ready.extend(node.waiting())
        self.check_timers(0)
        return True

    def remove_node(self, node: Any) -> None:
        """Remove a node; nothing happens if it is not in this executor."""
        if node in self._nodes:
            self._nodes.remove(node)
            self.ready = deque(receiver for receiver in self.ready if receiver.node is not node)
            node.executor = None

    def check_timers(self, due: float) -> None:
        """Check the timers again at `due` [ns]; any thread may call this."""
        self._soonest = min(self._soonest, due)
        if self.waits:
            self.awake.set()

    def next_due(self) -> float:
        """Return when the next callback is due [ns]; infinity: none is."""
        if self.ready:
            return self.world.now()
        self._soonest = min((timer.due for timer in self._timers()), default=inf)
        return self._soonest

    def _timers(self) -> list[Timer]:
        timers: list[Timer] = []
        for node in self._nodes:
            timers += node.timers
        return timers

    def run_once(self, until: float) -> bool:
        """Call one callback that is ready; otherwise wait for one, at most until `until` [ns]."""
        now = self.world.now()
        if now >= self._soonest:
            timers = sorted(self._timers(), key=lambda timer: timer.due)
            self.ready += [timer for timer in timers if timer.due <= now]
            self._soonest = min((timer.due for timer in timers if timer.due > now), default=inf)

        if self.ready:
            receiver = self.ready.popleft()
            if receiver.queue is None:
                receiver.run()  # a timer
            elif receiver.queue:
                receiver.callback(receiver.queue.popleft())
            return True

        self.waits = True
        try:
            self._wait(min(self.next_due(), until))
        finally:
            self.waits = False
        if not (self.world.is_ok or self._is_shutdown):
            raise ExternalShutdownException
        return False

    def _wake(self, _: Future) -> None:
        self.awake.set()

    def _wait(self, until: float) -> None:
        """Wait for an arrival, at most until `until` [ns]."""
        if self.world.simulated:
            self.world.pass_time(until)
            return
        left = (until - time.monotonic_ns()) / SECOND
        self.awake.wait(min(max(left, 0.0), _LONGEST_SLEEP))
        self.awake.clear()

    def spin(self) -> None:
        """Call callbacks until `shutdown`.

        Raises
        ------
        ExternalShutdownException
            rclpy was shut down meanwhile.
        """
        self._spin(Future(), None)

    def spin_until_future_complete(self, future: Future, timeout_sec: float | None = None) -> None:
        """Call callbacks until a future has its result.

        Parameters
        ----------
        future
            The future.
        timeout_sec
            The longest time [s]; by default there is no limit.

        Raises
        ------
        ExternalShutdownException
            rclpy was shut down meanwhile.
        """
        future.add_done_callback(self._wake)
        self._spin(future, timeout_sec)

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Call one callback.

        Parameters
        ----------
        timeout_sec
            The longest time [s] to wait for it; by default there is no limit.

        Raises
        ------
        ExternalShutdownException
            rclpy was shut down meanwhile.
        """
        self._spin(Future(), timeout_sec, once=True)

    def _spin(self, future: Future, timeout: float | None, *, once: bool = False) -> None:
        until = inf
        if timeout is not None and timeout >= 0:
            until = self.world.now() + int(timeout * SECOND)

        while self.world.is_ok and not self._is_shutdown and not future.is_done:
            has_called = self.run_once(until)
            if has_called and once:
                return
            if until != inf and self.world.now() >= until:
                return

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """End the spin, and release the nodes; return True."""
        del timeout_sec
        self._is_shutdown = True
        for node in [*self._nodes]:
            self.remove_node(node)
        self.awake.set()
        return True


#: One thread calls all callbacks, so that none run at the same time.
SingleThreadedExecutor = MultiThreadedExecutor = Executor


class CallbackGroup:
    """A group without effect: all callbacks exclude one another."""


MutuallyExclusiveCallbackGroup = ReentrantCallbackGroup = CallbackGroup
