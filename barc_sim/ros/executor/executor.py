"""The executor that runs use: rclpy's `MultiThreadedExecutor`, on events instead of wait sets.

Jazzy's own submits a callback to its pool again and again until it has begun
(https://github.com/ros2/rclpy/issues/1452), and builds a wait set for every callback. This one
lets DDS count what arrives, waits with epoll, and calls each callback once, in the thread that
polled; another thread polls when the callback lasts.
"""

from __future__ import annotations

import time
import traceback
from dataclasses import dataclass, replace
from functools import partial
from inspect import iscoroutinefunction
from math import inf
from threading import Event, Lock, RLock, get_ident
from typing import TYPE_CHECKING, Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import MultiThreadedExecutor, TimeoutObject

from barc_sim.ros.executor.events import Events
from barc_sim.ros.executor.leadership import LASTING, Leadership
from barc_sim.ros.executor.rclpy_private import notify_of_triggers
from barc_sim.ros.executor.thread_pool import TaskStepper, ThreadPool

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context
    from rclpy.task import Future

    from barc_sim.ros.executor.entities import Call, Entry

_CHECK_PERIOD = 0.1  # s
#: [s] `spin_once` waits so long for its callback's end, and then returns while it runs.
_BRIEF = 5e-3


@dataclass(eq=False, slots=True)
class Spin:
    """A call of one of the methods that spin."""

    future: Future | None
    deadline: float  #: [s]
    once: bool
    over: Event
    in_place: bool  #: whether callbacks run in the thread that polls, or are handed to the pool
    by_pool: bool = False  #: whether threads of the pool poll


class QuickExecutor(MultiThreadedExecutor):
    """A `MultiThreadedExecutor` that waits for events and calls every callback exactly once.

    A callback, of any group, runs in the thread that polled; another thread of the pool polls when
    it lasts longer than a millisecond. The promises of groups are kept, and `num_threads` callbacks
    run at the same time at most. Of several entities with messages, each is executed once in turn.
    An exception in a callback, wherever it ran, ends the spin at once; one in rclpy's own code
    (a clock's message with a time before 1970) is a warning.

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

    def __init__(self, num_threads: int | None = None, *, context: Context | None = None) -> None:
        super().__init__(num_threads, context=context)
        self._in_use = RLock()  # by the thread that spins
        self._spinner = 0  # that thread
        self._pool_spin: Spin | None = None  # for the threads of the pool to execute
        self._calls_in_place = False  # whether the thread that spins calls callbacks, too
        self._events = Events(self.context, self._fail)
        self._leadership = Leadership(self._events.wake)
        self._standing_by = Lock()  # by one thread of the pool
        self._stand_by_submitted = False
        self._pool = ThreadPool(self._executor, self._events.wake)
        self._stepper = TaskStepper(self, self._events.wake)
        notify_of_triggers(self._guard, self._on_change)

    def __del__(self) -> None:
        """Release the entities of an executor that was never shut down."""
        if hasattr(self, '_events'):
            self._events.close()
            self._leadership.close()
        super().__del__()

    def _fail(self, error: BaseException) -> None:
        self._pool.failures.append(error)
        self._end_spin()

    def _end_spin(self) -> None:
        """Have the spin look whether it is over."""
        if spin := self._pool_spin:
            spin.over.set()
        self._events.wake()

    def _on_change(self) -> None:
        """Look at the nodes again; a thread that polls does it by itself."""
        self._stepper.note_change()
        self._events.stale = True
        self._events.wake()
        self._refresh()

    def _refresh(self) -> None:
        while self._events.stale and not self._is_shutdown and self._leadership.take():
            try:
                self._events.refresh(self.get_nodes())
            finally:
                self._leadership.release()

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
        self._end_spin()
        self._leadership.wake_stand_by()
        inside = self._is_inside()
        timeout = 0 if inside else -1 if timeout_sec is None or timeout_sec < 0 else timeout_sec
        ended = self._pool.close(timeout)
        if (ended or inside) and self._in_use.acquire(timeout=timeout):
            if self._leadership.claim(inf if timeout < 0 else timeout):
                self._events.close()  # the thread that spins does it itself
                self._leadership.release()
            self._in_use.release()
        elif not inside:
            return False
        if ended:
            self._stepper.cancel_coroutines()
        while self._pool.failures:  # no spin is left to raise them
            traceback.print_exception(self._pool.failures.popleft())
        self._executor.shutdown(wait=wait_for_threads and not inside)
        if ended and not inside:
            self._leadership.close()
        # Not MultiThreadedExecutor's: a newer one waits for this thread, too.
        return bool(super(MultiThreadedExecutor, self).shutdown(timeout_sec))

    def _is_inside(self) -> bool:
        """Whether a callback of this executor runs in this thread."""
        return self._pool.is_inside() or self._spinner == get_ident()

    def _spin(
        self, timeout_sec: float | None, future: Future | None = None, *, once: bool = False
    ) -> None:
        deadline = inf if timeout_sec is None or timeout_sec < 0 else time.monotonic() + timeout_sec
        # A spin that may have to end while its callback runs has that run in another thread.
        endless = deadline == inf and future is None
        spin = Spin(future, deadline, once, Event(), in_place=not once or endless)

        def end(_: Future | None = None) -> None:
            spin.over.set()
            self._events.wake()

        if future:
            future.add_done_callback(end)
        try:
            if self._is_inside():
                self._spin_within(spin)
            else:
                self._spin_in_turn(spin)
        finally:
            if future:
                future.remove_done_callback(end)  # rclpy leaves one behind at every call
        if self._pool.failures:
            raise self._pool.failures.popleft()

    def _spin_in_turn(self, spin: Spin) -> None:
        while not self._in_use.acquire(timeout=0.05):  # another thread spins
            if time.monotonic() > spin.deadline or _is_done(spin.future):
                return
        self._spinner = get_ident()
        leads = False
        try:
            leads = self._leadership.claim(inf)
            self._calls_in_place = spin.once and spin.in_place
            if spin.in_place:
                self._pool_spin = replace(spin, deadline=inf, once=False, by_pool=True)
            if spin.once:
                if spin.in_place:
                    self._submit_stand_by()
                leads = self._lead(spin)
            else:
                leads = False
                self._have_pool_lead(spin)
        finally:
            self._pool_spin = None
            self._calls_in_place = False
            spin.over.set()
            try:
                if leads or self._leadership.claim(inf):
                    if self._is_shutdown:
                        self._events.close()
                    self._leadership.lend()
            finally:
                self._spinner = 0
                self._in_use.release()
                self._refresh()  # for what has changed meanwhile

    def _spin_within(self, spin: Spin) -> None:
        """Spin in a callback: lead, where no other thread does."""
        spin.in_place = spin.by_pool = True
        while not (self._is_over(spin) or time.monotonic() > spin.deadline):
            free = self._leadership.take()
            if free or (self._pool.is_full() and self._leadership.claim(0.01)):
                if self._lead(spin):
                    self._leadership.lend()
                if spin.once:
                    return
            spin.over.wait(0.01)

    def _have_pool_lead(self, spin: Spin) -> None:
        self._leadership.release()
        self._submit_stand_by()
        while not self._is_over(spin):
            left = spin.deadline - time.monotonic()
            if left <= 0:
                return
            spin.over.wait(min(left, _CHECK_PERIOD))

    def _submit_stand_by(self) -> None:
        """Have a thread of the pool stand by, unless one does or none is left."""
        if self._stand_by_submitted or self._standing_by.locked():
            return
        if self._calls_in_place and self._pool.is_full(besides=1):
            return
        self._stand_by_submitted = True

        def drop() -> None:
            self._stand_by_submitted = False

        self._pool.submit(self._lead_in_pool, drop)

    def _lead_in_pool(self) -> None:
        """Stand by, and lead when a callback of another thread lasts."""
        self._stand_by_submitted = False
        while spin := self._stand_by():
            self._submit_stand_by()
            leads = True
            try:
                leads = self._lead(spin)
            except BaseException as error:  # noqa: BLE001 - the spinning thread raises it
                self._fail(error)
            if leads:
                if self._is_over(spin):
                    spin.over.set()
                self._leadership.release()

    def _stand_by(self) -> Spin | None:
        """Return the spin for which to lead from now on, or None where none needs this thread."""
        while (spin := self._pool_spin) and self._standing_by.acquire(blocking=False):
            if self._calls_in_place and self._pool.is_full():  # the caller's thread is one more
                self._standing_by.release()
                return None
            try:
                while self._pool_spin is spin and not self._is_over(spin):
                    if self._leadership.take_over():
                        return spin
                    self._leadership.wait()
            finally:
                self._standing_by.release()
            if self._pool_spin is spin:
                return None
        return None

    def _is_over(self, spin: Spin) -> bool:
        return bool(
            spin.over.is_set()
            or self._pool.failures
            or self._is_shutdown
            or not self.context.ok()
            or _is_done(spin.future)
        )

    def _lead(self, spin: Spin) -> bool:
        """Poll and execute until the spin is over; return False where another thread leads."""
        events = self._events
        ready = events.ready
        events.woken = True
        progressed = False
        while True:
            if events.woken:
                events.woken = False
                if self._is_over(spin) or self._leadership.claimed:
                    return True
                if events.stale:
                    events.refresh(self.get_nodes())
                stepped = self._step_tasks(spin)
                if stepped is None or (stepped and spin.once):
                    return stepped is not None
                progressed = True
            now = events.poll(0 if progressed and ready else spin.deadline)
            executed = self._execute_ready(spin)
            if executed is None:
                return False
            if (executed and spin.once) or now >= spin.deadline:
                return True
            progressed = executed

    def _execute_ready(self, spin: Spin) -> bool | None:
        """Execute each entry that is ready once.

        Returns whether any was executed, or None where another thread leads now.
        """
        events = self._events
        ready = events.ready
        executed = False
        for _ in range(len(ready)):
            if not spin.by_pool and self._pool.is_full():
                break
            entry = ready.popleft()
            if not entry.pending:
                entry.queued = False
            elif not entry.begin():
                ready.append(entry)
            elif call := self._take(entry):
                executed = True
                if spin.in_place:
                    if not self._run(self._call, entry, call):
                        return None
                else:
                    self._hand_off(partial(self._call, entry, call), entry.end, entry)
                if spin.once or events.woken:  # it may be over
                    break
        return executed

    def _step_tasks(self, spin: Spin) -> bool | None:
        """Step each task that may go on; return the same as `_execute_ready`."""
        stepper = self._stepper
        stepped = False
        for task in stepper.due():
            if not spin.by_pool and self._pool.is_full():
                break
            stepper.begin(task)
            stepped = True
            if spin.in_place:
                if not self._run(stepper.step, None, task):
                    return None
            else:
                self._hand_off(partial(stepper.step, task), partial(stepper.drop, task), None)
            if spin.once:
                break
        return stepped

    def _take(self, entry: Entry) -> Call | None:
        """Return what is to be called for an entity whose group is claimed, or None for nothing."""
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
            elif entry.idle_uses:
                self._events.note_use(entry)
            if entry.on_taken:
                entry.on_taken(entry)
            if entry.pending:
                entry.found = entry.executed
                self._events.ready.append(entry)
            else:
                entry.queued = False
        return call

    def _run(self, call: Callable[..., object], entry: Entry | None, argument: Any) -> bool:  # noqa: ANN401
        """Call a callback or step a task here; return whether this thread still leads."""
        lent = self._leadership.lend(lasting=entry is not None and entry.lasting)
        try:
            call(entry, argument) if entry else call(argument)
        except BaseException as error:  # noqa: BLE001 - the spinning thread raises it
            self._fail(error)
        if self._tasks:  # one may wait for this
            self._events.woken = True
        leads = self._leadership.take_back(lent)
        if entry:
            entry.lasting = not leads and time.monotonic() - lent > LASTING
        if not leads:
            self._events.wake()  # its group is free
        return leads

    def _hand_off(
        self, function: Callable[[], object], drop: Callable[[], object], entry: Entry | None
    ) -> None:
        """Call a function in the pool; wait for its end, unless it lasts."""
        ended = Event()
        waits = not (entry and entry.lasting)

        def run() -> None:
            begun = time.monotonic()
            try:
                function()
            finally:
                if entry:
                    entry.lasting = time.monotonic() - begun > LASTING
                ended.set()

        self._pool.submit(run, drop)
        if waits:
            ended.wait(_BRIEF)

    def _call(self, entry: Entry, call: Call) -> None:
        """Call a callback whose group is claimed."""
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
            self._stepper.note_change()
            if claimed:
                entry.end()


def _is_done(future: Future | None) -> bool:
    return future is not None and (future.done() or future.cancelled())
