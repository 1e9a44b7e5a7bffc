"""The executor that runs use: rclpy's `MultiThreadedExecutor`, on events instead of wait sets.

Jazzy's own submits a callback to its pool again and again until it has begun
(https://github.com/ros2/rclpy/issues/1452), and builds a wait set for every callback. This one
lets DDS count what arrives, waits with epoll, and calls each callback once, in the thread that
polled; another thread polls when the callback lasts.
"""

from __future__ import annotations

import time
import traceback
from collections import deque
from dataclasses import dataclass, field
from inspect import iscoroutinefunction
from math import inf
from threading import Condition, Event, current_thread, get_ident
from typing import TYPE_CHECKING, Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import MultiThreadedExecutor, TimeoutObject
from rclpy.task import Task

from barc_sim.ros.executor.events import Events
from barc_sim.ros.executor.leadership import LASTING, Leadership
from barc_sim.ros.executor.rclpy_private import notify_of_triggers

if TYPE_CHECKING:
    from collections.abc import Coroutine

    from rclpy.context import Context
    from rclpy.task import Future

    from barc_sim.ros.executor.entities import Call, Entry

#: [s] So often a thread that waits for its spin's end looks whether all others are in callbacks.
_CHECK_PERIOD = 0.5
#: [s] A thread that has stood by while nothing spun ends after this time.
_LINGER = 0.05
_TRIES = 2


@dataclass(eq=False, slots=True)
class Spin:
    """A call of one of the methods that spin."""

    future: Future | None
    deadline: float  #: [s]
    once: bool
    here: bool = False  #: whether the thread that spins leads, too
    begun: bool = False  #: whether the one callback has
    over: Event = field(default_factory=Event)


class QuickExecutor(MultiThreadedExecutor):
    """A `MultiThreadedExecutor` that waits for events and calls every callback exactly once.

    A callback, of any group, runs in the thread of the pool that polled; another one polls when it
    lasts longer than a millisecond. The promises of groups are kept, and `num_threads` callbacks
    run at the same time at most. Of several entities with messages, each is executed once in turn.
    An exception in a callback ends the spin at once; one in rclpy's own code (a clock's message
    with a time before 1970) is a warning.

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
        self._spins: list[Spin] = []
        self._any_once = False  # whether one of them is to execute one callback alone
        self._failures: deque[BaseException] = deque()  # for the spinning threads to raise
        self._changed = Condition()  # of the next two
        self._working = 0  # threads that lead, call a callback or stand by
        self._standing_by = 0  # those of them that do
        self._joined: set[int] = set()  # those of them that are not the pool's
        self._events = Events(self.context, self._fail)
        self._leadership = Leadership()
        self._stepped: set[Task] = set()  # tasks that run now
        self._change: object = object()  # another one when a coroutine's wait may have ended
        notify_of_triggers(self._guard, self._on_change)

    def __del__(self) -> None:
        """Release the entities of an executor that was never shut down."""
        if hasattr(self, '_change'):
            self._close()
        super().__del__()

    def _close(self) -> None:
        while not self._leadership.take():
            self._leadership.wait_until_free()
        self._events.close()
        self._leadership.release()
        self._leadership.close()
        for task, entity, _ in self._tasks:
            if entity is not None:  # a callback's coroutine, which gives its group back
                task.cancel()

    def _fail(self, error: BaseException) -> None:
        self._failures.append(error)
        self._events.wake()

    def _on_change(self) -> None:
        """Look at the nodes again; a thread that polls does it by itself."""
        self._change = object()
        self._events.stale = True
        self._events.wake()
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
        self._end_spins()
        inside = self._is_inside()
        timeout = 0 if inside else None if timeout_sec is None or timeout_sec < 0 else timeout_sec
        with self._changed:
            ended = self._changed.wait_for(lambda: not self._working, timeout)
        if not (ended or inside):
            return False
        if ended:
            self._close()  # else the last thread does
        while self._failures:  # no spin is left to raise them
            traceback.print_exception(self._failures.popleft())
        self._executor.shutdown(wait=wait_for_threads and not inside)
        # Not MultiThreadedExecutor's: a newer one waits for this thread, too.
        return bool(super(MultiThreadedExecutor, self).shutdown(timeout_sec))

    def _is_inside(self) -> bool:
        """Whether a callback of this executor runs in this thread."""
        threads = self._executor._threads  # noqa: SLF001
        return current_thread() in threads or get_ident() in self._joined

    def _spin(
        self, timeout_sec: float | None, future: Future | None = None, *, once: bool = False
    ) -> None:
        """Have callbacks executed: by the pool, as this may have to end while one runs; or here."""
        deadline = inf if timeout_sec is None or timeout_sec < 0 else time.monotonic() + timeout_sec
        spin = Spin(future, deadline, once)

        def end(_: Future) -> None:
            spin.over.set()
            self._look_at_spins()

        if future:
            future.add_done_callback(end)
        self._spins.append(spin)
        inside = self._is_inside()
        spin.here = inside or (once and deadline == inf and not future and self._begin_work())
        try:
            self._look_at_spins()
            if not spin.here:
                self._wait_for(spin)
            elif inside:
                self._lead_here(spin)
            else:
                self._join(spin)
        finally:
            spin.over.set()
            self._spins.remove(spin)
            if future:
                future.remove_done_callback(end)  # rclpy leaves one behind at every call
            self._look_at_spins()
            # No callback is to begin any more.
            while not (self._spins or self._leadership.is_free):
                self._leadership.wait_until_free()
        if self._failures:
            raise self._failures.popleft()

    def _look_at_spins(self) -> None:
        """Have the leader look at them; after a callback it does by itself."""
        self._events.woken = True
        if not self._leadership.is_free:
            self._events.wake()

    def _wait_for(self, spin: Spin) -> None:
        """Wait until the leader has ended a spin; or no thread is left to lead, and it is time."""
        self._start_stand_by()
        self._leadership.wake_stand_by()
        while not spin.over.wait(max(1e-3, min(_CHECK_PERIOD, spin.deadline - time.monotonic()))):
            with self._changed:
                leading = self._standing_by or not self._leadership.is_free
            self._end_spins(expired=-inf if leading else time.monotonic())

    def _join(self, spin: Spin) -> None:
        """Spin in this thread, as if it was one of the pool."""
        self._joined.add(get_ident())
        try:
            self._start_stand_by()
            self._lead_here(spin)
        finally:
            self._joined.discard(get_ident())
            self._end_work()

    def _lead_here(self, spin: Spin) -> None:
        """Spin in a thread that may call callbacks: lead, where no other thread does."""
        while not (spin.over.is_set() or spin.begun):
            if self._leadership.take():
                if self._lead(spin):
                    self._release()
            elif not spin.over.wait(0.01):
                self._end_spins(expired=time.monotonic())

    def _release(self) -> None:
        """Have another thread lead, if there is a spin to lead for."""
        self._leadership.release(0.0 if self._needs_pool() else _LINGER)

    def _end_spins(self, expired: float = -inf) -> None:
        """End the spins that are over, or whose time is."""
        ended = bool(self._failures) or self._is_shutdown or not self.context.ok()
        for spin in list(self._spins):
            done = spin.future is not None and (spin.future.done() or spin.future.cancelled())
            once = spin.begun and not spin.here
            if ended or done or once or spin.deadline <= expired:
                spin.over.set()
        if ended:
            self._events.wake()
            self._leadership.wake_stand_by()

    def _begin_work(self) -> bool:
        """Count a thread as one that may call callbacks; return False where they are too many."""
        with self._changed:
            most = self._executor._max_workers  # noqa: SLF001
            if self._is_shutdown or self._working >= most:
                return False
            self._working += 1
            return True

    def _end_work(self) -> None:
        with self._changed:
            self._working -= 1
            if self._is_shutdown and not self._working:
                self._close()
            self._changed.notify_all()

    def _start_stand_by(self) -> None:
        """Have a thread of the pool stand by, unless one does or none is left."""
        with self._changed:
            if not self._standing_by and self._begin_work():
                self._standing_by += 1
                self._executor.submit(self._work)

    def _work(self) -> None:
        """Stand by, and lead when a callback of another thread lasts."""
        try:
            while self._stand_by():
                self._start_stand_by()
                if self._lead():
                    self._release()
                with self._changed:
                    self._standing_by += 1
        finally:
            self._end_work()
            self._leadership.wake_stand_by()  # for another thread to end

    def _stand_by(self) -> bool:
        """Return whether this thread leads from now on: False where nothing spins any longer."""
        leads = waited = False
        while not leads:
            with self._changed:
                if not self._is_spinning():
                    if waited:
                        self._standing_by -= 1
                        return False
                    self._leadership.wake_stand_by(_LINGER)  # another spin may follow
            leads = self._leadership.take_over(wanted=self._needs_pool())
            waited = True
        with self._changed:
            self._standing_by -= 1
        return True

    def _is_spinning(self) -> bool:
        return not all(spin.over.is_set() for spin in list(self._spins))

    def _needs_pool(self) -> bool:
        """Return whether a thread of the pool is to lead; a thread that spins here may do that."""
        return any(
            not spin.over.is_set() and (spin.begun or not spin.here) for spin in list(self._spins)
        )

    def _is_over(self, within: Spin | None) -> bool:
        """End the spins that are over; return whether a thread is to lead no longer for them."""
        self._end_spins()
        if within is None:
            return not self._needs_pool()
        if within.begun:
            within.over.set()
        return within.over.is_set()

    def _lead(self, within: Spin | None = None) -> bool:
        """Poll and execute until all spins, or the one `within` a callback, are over.

        Returns False where another thread leads.
        """
        events = self._events
        ready = events.ready
        events.woken = True
        events.poll_due = 0.0
        deadline = inf
        executed: bool | None = True
        try:
            while True:
                if events.woken:
                    events.woken = False
                    if self._is_over(within):
                        return True
                    spins = [spin for spin in self._spins if not spin.over.is_set()]
                    self._any_once = any(spin.once and not spin.begun for spin in spins)
                    deadline = min((spin.deadline for spin in spins), default=inf)
                    if events.stale:
                        events.refresh(self.get_nodes())
                    if not self._step_tasks():
                        return False
                    if self._any_once and any(spin.begun for spin in spins):
                        continue
                    executed = True
                now = events.poll(0 if executed and ready else deadline)
                executed = self._execute_ready()
                if executed is None:
                    return False
                if now >= deadline:
                    self._end_spins(expired=now)
                    events.woken = True
        except BaseException as error:  # noqa: BLE001 - the spinning thread raises it
            self._fail(error)
            return True

    def _step_tasks(self) -> bool:
        """Step each task that may go on; return whether this thread still leads."""
        for task in self._due_tasks() if self._tasks else ():
            if not self._run(None, (self._step, (task,))):
                return False
            if self._any_once:
                break
        return True

    def _due_tasks(self) -> list[Task]:
        """Return the tasks that are new or may go on, the newest first, as in rclpy."""
        nodes = (None, *self.get_nodes())
        with self._tasks_lock:
            self._tasks[:] = [
                each for each in self._tasks if not (each[0].done() or each[0].cancelled())
            ]
            return [
                task
                for task, _, node in reversed(self._tasks)
                if task not in self._stepped
                and node in nodes
                and getattr(task, 'seen', None) is not self._change
            ]

    def _step(self, task: Task, entry: Entry | None = None) -> None:
        """Run a task, or a callback's coroutine for the first time, until it has to wait."""
        self._stepped.add(task)
        task.seen = self._change
        try:
            task()
        finally:
            self._stepped.discard(task)
        if task.done():
            self._change = object()
            task.result()  # raises
        elif entry:
            with self._tasks_lock:
                self._tasks.append((task, entry.entity, entry.node))
            self._events.wake()

    def _execute_ready(self) -> bool | None:
        """Execute each entry that is ready once.

        Returns whether any was executed, or None where another thread leads now.
        """
        events = self._events
        ready = events.ready
        executed = False
        for _ in range(len(ready)):
            entry = ready.popleft()
            if not entry.pending:
                entry.queued = False
            elif not entry.begin():
                ready.append(entry)
            elif call := self._take(entry):
                executed = True
                if not self._run(entry, call):
                    return None
                if events.woken:  # it may be over
                    break
        return executed

    def _take(self, entry: Entry) -> Call | None:
        """Return what is to be called for an entity whose group is claimed, or None for nothing."""
        call = None
        entry.executed = self._events.now
        entry.pending -= 1
        try:
            call = entry.take(entry, self)
        except InvalidHandle:  # destroyed without its node
            entry.pending = 0
        except Exception as error:
            if not entry.warns_of(error, taking=True):
                raise
        finally:
            if call is None:
                entry.ahead = max(0, entry.ahead - 1)
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
                if call is not None and entry.kind == 'subscriptions' and not entry.idle_uses:
                    self._events.recent[entry] = None
                    entry.tries = _TRIES
        return call

    def _run(self, entry: Entry | None, call: Call) -> bool:
        """Call a callback whose group is claimed, or step a task; return whether this still leads.

        While the callback runs, another thread may take over.
        """
        callback, args = call
        claimed = entry
        if self._any_once:
            self._begin_once()
        lent = self._leadership.lend(entry is not None and entry.lasting)
        try:
            result = callback(*args)
            if result is not None and entry and iscoroutinefunction(callback):
                claimed = None
                self._step(Task(_finish(entry, result), executor=self), entry)
        except BaseException as error:  # noqa: BLE001 - warned of, or the spinning thread raises it
            if not (entry and entry.warns_of(error)):
                self._fail(error)
        finally:
            if claimed:  # after the failure, which ends spins before another of its group begins
                claimed.end()
        leads = self._leadership.take_back(lent)
        if entry:
            self._change = lent  # a coroutine in another thread may wait for this, but be no task
        if self._tasks:
            self._events.woken = True
        if not leads:
            self._events.wake()  # its group is free
        if entry and (entry.lasting or not leads):
            entry.lasting = not leads and time.monotonic() - lent > LASTING
        return leads

    def _begin_once(self) -> None:
        """Note that a spin that is to execute one callback does so now."""
        for spin in list(self._spins):
            spin.begun = spin.once
        self._events.woken = True


async def _finish(entry: Entry, coroutine: Coroutine[Any, Any, Any]) -> None:
    """Await a callback's coroutine, and give its group back."""
    try:
        await coroutine
    except Exception as error:
        if not entry.warns_of(error):
            raise
    finally:
        entry.end()
