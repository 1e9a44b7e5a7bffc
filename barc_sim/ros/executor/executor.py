"""The executor that runs use: rclpy's `MultiThreadedExecutor`, on events instead of wait sets.

Jazzy's own submits a callback to its pool again and again until it has begun
(https://github.com/ros2/rclpy/issues/1452), and builds a wait set for every callback. This one
submits once, lets DDS count what arrives, waits with epoll, and runs the callbacks of a
`QuickCallbackGroup` in the thread that spins.
"""

# ruff: noqa: SLF001 - `rclpy_private` checks rclpy's private names.

from __future__ import annotations

import sys
import time
import traceback
import warnings
from functools import partial
from inspect import iscoroutinefunction
from math import inf
from threading import RLock, get_ident
from typing import TYPE_CHECKING, Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import MultiThreadedExecutor, TimeoutObject

from barc_sim.ros.executor.events import Events
from barc_sim.ros.executor.rclpy_private import differing, notify_of_triggers
from barc_sim.ros.executor.thread_pool import TaskStepper, ThreadPool

if TYPE_CHECKING:
    from rclpy.context import Context
    from rclpy.task import Future

    from barc_sim.ros.executor.entities import Call, Entry

#: In debug mode, a quick callback that takes longer is warned of [s].
QUICK_LIMIT = 2e-3


class QuickExecutor(MultiThreadedExecutor):
    """A `MultiThreadedExecutor` that waits for events and calls every callback exactly once.

    Callbacks in a `QuickCallbackGroup` run in the spinning thread, all others in the pool, with
    their groups' promises kept. Of several entities with messages, each is executed once in turn.
    An exception in a callback, wherever it ran, ends the spin at once; one in rclpy's own code
    (a clock's message with a time before 1970) is a warning. `debug` (by default in
    `python -X dev`) warns of quick callbacks that take longer than `QUICK_LIMIT`.

    Examples
    --------
    >>> import rclpy
    >>> rclpy.init()
    >>> node, executor = rclpy.create_node('clockwork'), QuickExecutor()
    >>> timer = node.create_timer(0.01, lambda: print('tick'))
    >>> executor.add_node(node)
    True
    >>> executor.spin_once(timeout_sec=1.0)
    tick
    >>> executor.shutdown()
    True
    """

    def __init__(
        self,
        num_threads: int | None = None,
        *,
        context: Context | None = None,
        debug: bool = sys.flags.dev_mode,
    ) -> None:
        super().__init__(num_threads, context=context)
        self._debug = debug
        self._in_use = RLock()  # of `_events`, by the thread that spins
        self._spinner = 0  # that thread
        self._events = Events(self.context, self._fail)
        self._pool = ThreadPool(self._executor, self._events.wake)
        self._stepper = TaskStepper(self, self._pool, self._events.wake)
        notify_of_triggers(self._guard, self._on_change)

    def __del__(self) -> None:
        """Release the entities of an executor that was never shut down."""
        if hasattr(self, '_events'):
            self._events.close()
        super().__del__()

    def _fail(self, error: BaseException) -> None:
        self._pool.failures.append(error)
        self._events.wake()

    def _on_change(self) -> None:
        """Look at the nodes again; a thread that spins does it by itself."""
        self._stepper.progress += 1
        self._events.stale = True
        self._events.wake()
        self._refresh()

    def _refresh(self) -> None:
        while self._events.stale and not self._is_shutdown and self._in_use.acquire(blocking=False):
            try:
                self._events.refresh(self.get_nodes())
            finally:
                self._in_use.release()

    def spin(self) -> None:
        """Execute callbacks until the executor or its context is shut down."""
        self._spin(None)

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Execute one callback, or return because the time is over."""
        self._spin(timeout_sec, once=True)

    def spin_until_future_complete(self, future: Future, timeout_sec: float | None = None) -> None:
        """Execute callbacks until the future is done or the time is over."""
        self._spin(timeout_sec, future)

    def spin_once_until_future_complete(
        self, future: Future, timeout_sec: float | TimeoutObject | None = None
    ) -> None:
        """Execute one callback, or return because the future is done or the time is over."""
        seconds = timeout_sec.timeout if isinstance(timeout_sec, TimeoutObject) else timeout_sec
        self._spin(seconds, future, once=True)

    def shutdown(self, timeout_sec: float | None = None, *, wait_for_threads: bool = True) -> bool:
        """Stop, wait for the callbacks that have begun, and end the pool's threads.

        Returns False where callbacks still ran after `timeout_sec` (None or negative: no end);
        call it again then. From within a callback it returns at once.
        """
        self._is_shutdown = True
        self._events.wake()
        inside = self._pool.is_inside() or self._spinner == get_ident()
        timeout = 0 if inside else -1 if timeout_sec is None or timeout_sec < 0 else timeout_sec
        ended = self._pool.close(timeout)
        if (ended or inside) and self._in_use.acquire(timeout=timeout):
            self._events.close()  # the thread that spins does it itself
            self._in_use.release()
        elif not inside:
            return False
        if ended:
            self._stepper.cancel_coroutines()
        while self._pool.failures:  # no spin is left to raise them
            traceback.print_exception(self._pool.failures.popleft())
        self._executor.shutdown(wait=wait_for_threads and not inside)
        # Not MultiThreadedExecutor's: a newer one waits for this thread, too.
        return bool(super(MultiThreadedExecutor, self).shutdown(timeout_sec))

    def _spin(
        self, timeout_sec: float | None, future: Future | None = None, *, once: bool = False
    ) -> None:
        deadline = inf if timeout_sec is None or timeout_sec < 0 else time.monotonic() + timeout_sec

        def wake(_: Future | None = None) -> None:
            self._events.wake()

        if future:
            future.add_done_callback(wake)
        while not self._in_use.acquire(timeout=0.05):  # another thread spins
            if time.monotonic() > deadline or (future and not future._pending()):
                return
        spinner, self._spinner = self._spinner, get_ident()
        try:
            self._execute_until(deadline, future, once=once)
        finally:
            self._spinner = spinner
            if self._is_shutdown:
                self._events.close()
            self._in_use.release()
            self._refresh()  # for what has changed meanwhile
            if future:
                future.remove_done_callback(wake)  # rclpy leaves one behind at every call

    def _execute_until(self, deadline: float, future: Future | None, *, once: bool) -> None:
        events = self._events
        ready = events.ready
        events.woken = True
        progressed = False
        while True:
            if events.woken:
                events.woken = False
                if self._is_over(future) or (self._stepper.submit(once=once) and once):
                    return
                progressed = True
            now = events.poll(0 if progressed and ready else deadline)
            progressed = self._execute_ready(once=once)
            if (progressed and once) or now >= deadline:
                return

    def _is_over(self, future: Future | None) -> bool:
        """Raise what has failed in the pool, look at the nodes; return whether the spin is over."""
        if self._pool.failures:
            raise self._pool.failures.popleft()
        if self._is_shutdown or not self.context.ok() or (future and not future._pending()):
            return True
        self._refresh()
        return False

    def _execute_ready(self, *, once: bool) -> bool:
        """Execute each entry that is ready once; return whether any was executed."""
        ready = self._events.ready
        progressed = False
        blocked = []
        try:
            for _ in range(len(ready)):
                entry = ready.popleft()
                if not entry.pending:
                    entry.queued = False
                elif not (entry.quick or entry.may_begin()) or not entry.begin():
                    blocked.append(entry)
                elif self._execute(entry):
                    progressed = True
                    if once:
                        break
        finally:
            if blocked:
                ready.extendleft(reversed(blocked))
        return progressed

    def _execute(self, entry: Entry) -> bool:
        """Take what is there for an entity and call its callback; return False for nothing."""
        call = None
        entry.executed = self._events.now
        entry.pending -= 1
        try:
            call = entry.take(entry, self)
        except InvalidHandle:  # destroyed without its node
            entry.pending = 0
        except Exception as error:  # noqa: BLE001 - warned of or raised
            entry.warn_or_raise(error, taking=True)
        finally:
            if call is None:
                entry.end()
            if entry.on_taken:
                entry.on_taken(entry)
            if entry.pending:
                entry.found = entry.executed
                self._events.ready.append(entry)
            else:
                entry.queued = False
        if call is None:
            return False
        if not entry.quick:
            entry.handed_off = True
            self._pool.submit(partial(self._call, entry, call), entry.drop)
        elif self._debug:
            self._call_timed(entry, call)
        else:
            self._call(entry, call)
        return True

    def _call(self, entry: Entry, call: Call) -> None:
        """Call a callback whose group is claimed."""
        if entry.handed_off:
            entry.handed_off = False
            if entry.pending:
                self._events.wake()  # another thread may take the next, too
        callback, args = call
        claimed = True
        try:
            result = callback(*args)
            if result is not None and iscoroutinefunction(callback):
                claimed = False
                self._stepper.start(entry, result)
        except Exception as error:  # noqa: BLE001 - warned of or raised
            entry.warn_or_raise(error)
        finally:
            self._stepper.progress += 1
            if claimed:
                entry.end()

    def _call_timed(self, entry: Entry, call: Call) -> None:
        begun = time.perf_counter()
        self._call(entry, call)
        took = time.perf_counter() - begun
        if took > QUICK_LIMIT:
            entry.node.get_logger().warning(
                f'the quick callback of {entry.name!r} took {took * 1e3:.1f} ms, more than '
                f'{QUICK_LIMIT * 1e3:g} ms: shorten it or put it into another callback group'
            )


if names := differing():
    warnings.warn(
        f'this rclpy has no {", ".join(names)}: QuickExecutor is a MultiThreadedExecutor; '
        'use rclpy 7.1 for a fast one',
        stacklevel=2,
    )

    class QuickExecutor(MultiThreadedExecutor):  # type: ignore[no-redef]
        """rclpy's own."""

        def __init__(self, *args: Any, debug: bool = False, **options: Any) -> None:  # noqa: ANN401
            del debug
            super().__init__(*args, **options)
