"""The executor that runs use: rclpy's `MultiThreadedExecutor`, on events instead of wait sets."""

from __future__ import annotations

import time
import traceback
from dataclasses import dataclass, field
from inspect import iscoroutinefunction
from math import inf
from threading import Event, RLock, Thread, current_thread
from typing import TYPE_CHECKING, Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import MultiThreadedExecutor
from rclpy.task import Future, Task

from barc_sim.ros.executor.events import Events
from barc_sim.ros.executor.rclpy_private import notify_of_triggers
from barc_sim.ros.executor.waiting import LASTING, Leadership, shorten_slices

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rclpy.context import Context
    from rclpy.executors import TimeoutObject
    from rclpy.node import Node

    from barc_sim.ros.executor.entities import Call, Entry

#: [s] between two checks of a spin whether all threads are in callbacks; of a spin in a callback.
_CHECK_PERIOD, _CHECK_PERIOD_INSIDE = 0.5, 0.01
#: Whether rclpy (7.1.9 and later) resumes a task itself, when the future that it awaits is done.
_RESUMES = hasattr(MultiThreadedExecutor, '_call_task_in_next_spin')
#: [s] without a spin after which a thread that stands by ends.
_LINGER = 0.05


@dataclass(eq=False, slots=True)
class Spin:
    """A call of one of the methods that spin."""

    future: Future
    deadline: float  #: [s]; -inf: it ends now
    once: bool  #: whether it ends after one callback, which has not begun
    over: Event = field(default_factory=Event)


class _Lost(Exception):  # noqa: N818 - no error
    """Another thread leads now."""


class QuickExecutor(MultiThreadedExecutor):
    """A `MultiThreadedExecutor` that waits for events and calls every callback exactly once.

    The pool's thread that polled runs the callback, of any group; when the callback lasts longer
    than a millisecond, another thread polls. Callback groups hold, and at most `num_threads`
    callbacks run at the same time. Entities with waiting messages take turns, one message each. An
    exception in a callback ends the spin at once; an exception in rclpy's own code is a warning.
    """

    def __init__(self, num_threads: int | None = None, *, context: Context | None = None) -> None:
        super().__init__(num_threads, context=context)
        self._tasks: dict[Task, Entry | None] = {}  # oldest first; entry: of a callback's coroutine
        self._spins: set[Spin] = set()  # spins that are not over
        self._never_done = Future()  # of spins without a future
        self._once: list[Spin] = []  # spins whose one callback has not begun
        self._threads: set[Thread] = set()  # daemons, so that a program can end while they spin
        self._standing_by = 0  # number of threads that neither lead nor call a callback
        self._lock = RLock()  # of `_threads` and `_standing_by`
        self._events = Events(self.context)
        self._leadership = Leadership()
        self._change: object = object()  # a new one when a coroutine's wait may have ended
        self._have_stepped = False  # whether tasks were stepped since the last poll
        notify_of_triggers(self._guard, self._on_change)
        self._closed = False

    def __del__(self) -> None:
        """Release the entities of an executor that was never shut down."""
        self._close()
        super().__del__()

    def _close(self) -> None:
        closed, self._closed = getattr(self, '_closed', True), True
        if not closed:
            while not self._leadership.take():
                time.sleep(1e-4)
            self._events.close()
            self._leadership.close()
            for task in [task for task, entry in self._tasks.copy().items() if entry]:
                task.cancel()  # a callback's coroutine, which releases its group

    def _on_change(self) -> None:
        """Refresh the nodes' entities, unless a polling thread does it."""
        self._change = object()
        self._events.stale = True
        self._events.wake()
        while self._events.stale and not self._is_shutdown and self._leadership.take():
            try:
                self._events.refresh(self.get_nodes())
            finally:
                self._leadership.release()

    def remove_node(self, node: Node) -> None:
        """Remove a node; after that, another executor can listen to its entities."""
        super().remove_node(node)
        while self._events.listens_to(node) and not (self._is_shutdown or node in self.get_nodes()):
            self._on_change()
            time.sleep(1e-4)

    def create_task(self, callback: Callable[..., Any], *args: Any, **kwargs: Any) -> Task:  # noqa: ANN401
        """Execute a function or a coroutine function in the next spin; return its future."""
        task = Task(callback, args, kwargs, executor=self)
        self._call_task_in_next_spin(task)
        return task

    def _call_task_in_next_spin(self, task: Task) -> None:
        """Step a new task soon, or one whose coroutine yields without a future."""
        task.seen = self  # no `_change` yet
        self._tasks[task] = self._tasks.pop(task, None)  # after the others
        self._change = object()
        self._events.wake()

    def spin(self) -> None:
        """Execute callbacks until the executor or its context is shut down."""
        self._spin(None)

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Execute one callback, or none within the timeout."""
        self._spin(timeout_sec, once=True)

    def spin_until_future_complete(self, future: Future, timeout_sec: float | None = None) -> None:
        """Execute callbacks until the future is done or the timeout is over."""
        self._spin(timeout_sec, future)

    def spin_once_until_future_complete(
        self, future: Future, timeout_sec: float | TimeoutObject | None = None
    ) -> None:
        """Execute one callback, or none when the future is done or the timeout is over."""
        self._spin(getattr(timeout_sec, 'timeout', timeout_sec), future, once=True)

    def shutdown(self, timeout_sec: float | None = None, *, wait_for_threads: bool = True) -> bool:
        """Stop, wait for the callbacks that have begun, and end the pool's threads.

        Returns False if callbacks still run after `timeout_sec` (None or negative: no limit); call
        it again then. Within a callback, or without `wait_for_threads`, it returns at once.
        """
        timeout_sec = timeout_sec if wait_for_threads else 0.0
        self._is_shutdown = True
        self._end_spins()
        with self._lock:
            threads = list(self._threads)
        if current_thread() not in threads:  # else the last thread closes
            end = inf if timeout_sec is None or timeout_sec < 0 else time.monotonic() + timeout_sec
            for thread in threads:
                thread.join(None if end == inf else max(0.0, end - time.monotonic()))
            if any(thread.is_alive() for thread in threads):
                return False
            self._close()
        while self._events.failures:  # no spin is left to raise them
            traceback.print_exception(self._events.failures.popleft())
        return bool(super().shutdown(timeout_sec))

    def _spin(
        self, timeout_sec: float | None, future: Future | None = None, *, once: bool = False
    ) -> None:
        """Let the pool execute callbacks, because a spin may have to end while one runs.

        Within a callback this thread is one of the pool, and leads if no other thread does.
        """
        deadline = inf if timeout_sec is None or timeout_sec < 0 else time.monotonic() + timeout_sec
        future = future or self._never_done
        spin = Spin(future, deadline, once)
        inside = current_thread() in self._threads
        period = _CHECK_PERIOD_INSIDE if inside else _CHECK_PERIOD
        future.add_done_callback(self._events.wake)
        self._spins.add(spin)
        self._is_spinning = True  # for rclpy's `is_spinning`
        try:
            self._events.wake()
            self._start_stand_by()
            self._leadership.wake_stand_by()
            while not spin.over.is_set():
                if inside and self._leadership.take():
                    self._lead(spin)
                elif not spin.over.wait(max(1e-3, min(period, deadline - time.monotonic()))):
                    leading = self._standing_by or not self._leadership.free
                    self._end_spins(expired=-inf if leading else time.monotonic())
        finally:
            self._spins.discard(spin)
            self._is_spinning = bool(self._spins)
            future.remove_done_callback(self._events.wake)  # rclpy does not
            self._events.wake()
            # After the spin no callback may begin: wait until no thread leads.
            while not (self._spins or self._leadership.free):
                time.sleep(1e-4)
        if self._events.failures:
            raise self._events.failures.popleft()

    def _end_spins(self, expired: float = -inf) -> None:
        """End the spins that are done, and those whose deadline is `expired` [s] or earlier."""
        ended = bool(self._events.failures) or self._is_shutdown or not self.context.ok()
        for spin in list(self._spins):
            if ended or spin.future.done() or spin.future.cancelled() or spin.deadline <= expired:
                self._spins.discard(spin)
                spin.over.set()
        if ended:
            self._events.wake()
            self._leadership.wake_stand_by()

    def _start_stand_by(self, instead: int = 0) -> None:
        """Start a thread in place of `instead` that stood by, unless one does or none is left."""
        with self._lock:
            self._standing_by -= instead
            maximum = self._executor._max_workers  # noqa: SLF001
            if not (self._standing_by or self._is_shutdown or len(self._threads) >= maximum):
                self._standing_by += 1
                thread = Thread(target=self._work, daemon=True)
                self._threads.add(thread)
                thread.start()

    def _work(self) -> None:
        """Stand by, and lead when a callback of another thread lasts, until nothing spins."""
        waited = False
        shorten_slices()
        while True:
            with self._lock:
                if not self._spins and (waited or self._is_shutdown):
                    self._standing_by -= 1
                    self._threads.discard(current_thread())
                    if self._is_shutdown and not self._threads:
                        self._close()
                    break
                if waited := not self._spins:
                    self._leadership.wake_stand_by(_LINGER)  # another spin may follow
            if self._leadership.take_over(wanted=not waited):
                self._start_stand_by(instead=1)
                self._lead()
                with self._lock:
                    self._standing_by += 1
        self._leadership.wake_stand_by()  # for another thread to end

    def _lead(self, within: Spin | None = None) -> None:
        """Poll and execute until all spins, or the one `within` a callback, are over."""
        events = self._events
        events.woken = True
        events.poll_due = 0.0
        try:
            while True:
                if events.woken:
                    events.woken = False
                    self._end_spins()
                    spins = list(self._spins)
                    if not spins or (within and within.over.is_set()):
                        break
                    self._once = [spin for spin in spins if spin.once]
                    deadline = min(spin.deadline for spin in spins)
                    if events.stale:
                        events.refresh(self.get_nodes())
                    self._step_tasks()
                    if events.woken:
                        continue
                    executed = True
                stepped, self._have_stepped = self._have_stepped, False
                now = events.poll(0 if stepped or (executed and events.ready) else deadline)
                executed = not events.ended and self._execute_ready()
                if stepped or now >= deadline:
                    events.woken = True
                if now >= deadline:
                    self._change = object()
                    self._end_spins(expired=now)
        except _Lost:
            return
        except BaseException as error:  # noqa: BLE001 - the spinning thread raises it
            self._events.fail(error)
        self._leadership.release(0.0 if self._spins or self._is_shutdown else _LINGER)

    def _step_tasks(self) -> None:
        """Step each task that is new or may continue, in rclpy's order, once between two polls."""
        nodes, once = [None, *self.get_nodes()], self._once
        # A copy, because other threads create tasks.
        tasks = ({} if self._have_stepped else self._tasks.copy()).items()
        for task, entry in tasks if _RESUMES else reversed(tasks):
            is_due = not task.executing() and task.seen not in (None, self._change)
            if task.done() or task.cancelled():
                self._tasks.pop(task, None)
                if error := task.exception():
                    self._events.fail(error)
            elif is_due and getattr(entry, 'node', None) in nodes:
                self._have_stepped = True  # the ready entries are next
                self._run(None, (self._step, (task,)))
                if once:
                    break

    def _step(self, task: Task, entry: Entry | None = None) -> None:
        """Run a task, or a callback's coroutine for the first time, until it has to wait."""
        task.seen = None if _RESUMES else self._change
        task()
        if task.done():
            self._change = object()
            self._tasks.pop(task, None)
            task.result()  # raises its exception
        elif entry:
            self._tasks[task] = entry
            self._events.wake()

    def _execute_ready(self) -> bool:
        """Execute each entry that is ready once; return whether any was executed."""
        events, executed = self._events, False
        for _ in range(len(events.ready)):
            entry = events.ready.popleft()
            if not entry.begin():
                events.ready.append(entry)
            elif call := self._take(entry):
                executed = True
                self._run(entry, call)
                if events.woken:  # the spin may be over
                    break
        return executed

    def _take(self, entry: Entry) -> Call | None:
        """Return the call that is due for an entity whose group is claimed, or None."""
        call = None
        try:
            call = entry.take(entry, self)
            if call is None:
                entry.pending = 1  # there was nothing to take
        except InvalidHandle:
            entry.pending = 1  # destroyed without its node
        except Exception as error:
            if not entry.warns_of(error, while_taking=True):
                raise
        finally:
            if call is None:
                entry.end()
            elif entry.idle_uses:
                self._events.note_use(entry)
            entry.pending -= 1
            if entry.pending:
                self._events.ready.append(entry)
            if entry.on_taken:
                entry.on_taken(entry)
        return call

    def _run(self, entry: Entry | None, call: Call) -> None:
        """Call a callback whose group is claimed, or step a task.

        Raises _Lost if another thread has taken over meanwhile.
        """
        callback, args = call
        claimed = entry
        once, self._once = self._once, []
        for spin in once:  # without a deadline it ends when the callback returns
            spin.once, spin.deadline = False, inf if spin.deadline == inf else -inf
        lent = self._leadership.lend(entry is not None and entry.lasting)
        try:
            result = callback(*args)
            if result is not None and entry and iscoroutinefunction(callback):
                claimed = None
                self._step(Task(_finish(entry, result), executor=self), entry)
        except BaseException as error:  # noqa: BLE001 - warned of, or the spinning thread raises it
            if not (entry and entry.warns_of(error)):
                self._events.fail(error)
        finally:
            if claimed:  # after `fail`: the spin ends before the next callback of the group
                claimed.end()
        for spin in once:
            spin.deadline = -inf  # the next `_end_spins` ends it
        leads = self._leadership.take_back(lent)
        if entry:
            # A coroutine that another thread steps, and that is no task yet, may wait for this.
            self._change = lent
            entry.lasting = not leads and time.monotonic() - lent > LASTING
        if self._tasks or once:
            self._events.woken = True
        if not leads:
            self._events.wake()  # its group is free
            raise _Lost


async def _finish(entry: Entry, coroutine: Coroutine[Any, Any, Any]) -> None:
    """Await a callback's coroutine, and release its group."""
    try:
        await coroutine
    except Exception as error:
        if not entry.warns_of(error):
            raise
    finally:
        entry.end()
