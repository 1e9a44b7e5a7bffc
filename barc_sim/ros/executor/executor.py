"""The executor that runs use: rclpy's `MultiThreadedExecutor`, on events instead of wait sets."""

from __future__ import annotations

import os
import time
import traceback
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from inspect import iscoroutinefunction
from math import inf
from threading import RLock, Thread, current_thread
from typing import TYPE_CHECKING, Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import MultiThreadedExecutor
from rclpy.task import Future, Task

from barc_sim.ros.executor.events import Events
from barc_sim.ros.executor.leadership import LASTING, Leadership
from barc_sim.ros.executor.linux import shorten_slices
from barc_sim.ros.executor.rclpy_private import notify_of_triggers
from barc_sim.ros.executor.spins import Spin, SpinPhase
from barc_sim.ros.executor.tasks import Tasks, WhenDone

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rclpy.context import Context
    from rclpy.executors import TimeoutObject
    from rclpy.node import Node

    from barc_sim.ros.executor.entities import Call, Entry

#: [s] between two checks of a spin whether all threads are in callbacks.
_CHECK_PERIOD = 0.5
#: [s] the same for a spin in a callback.
_CHECK_PERIOD_INSIDE = 0.01
#: [s] without a spin after which a thread that stands by ends.
_LINGER = 0.05
#: [s] between two looks at what another thread is about to finish.
_YIELD = 1e-4


class _LeadershipLost(Exception):  # noqa: N818 - no error
    """Another thread leads now."""


class QuickExecutor(MultiThreadedExecutor):
    """A `MultiThreadedExecutor` that waits for events and calls every callback exactly once.

    The pool's thread that polled runs the callback, of any group; when the callback lasts longer
    than a millisecond, another thread polls. Callback groups hold, and at most `num_threads`
    callbacks run at the same time. Entities with waiting messages take turns, one message each. An
    exception in a callback ends the spin at once; an exception in rclpy's own code is a warning.

    Parameters
    ----------
    num_threads : int, optional
        The maximum number of callbacks that run at the same time; by default the number of cores
        that the process may use.
    context : rclpy.context.Context, optional
        The context of its nodes; by default rclpy's default context.

    Examples
    --------
    >>> from barc_sim.ros.executor import QuickExecutor
    >>> with QuickExecutor(num_threads=2) as executor:  # doctest: +SKIP
    ...     executor.add_node(node)
    ...     executor.spin()
    """

    def __init__(self, num_threads: int | None = None, *, context: Context | None = None) -> None:
        if num_threads is None:
            num_threads = len(os.sched_getaffinity(0))
        # For one thread rclpy advises SingleThreadedExecutor, which here is no better.
        super().__init__(2 if num_threads == 1 else num_threads, context=context)
        self._executor = ThreadPoolExecutor(num_threads)  # only its size is used
        self._max_threads = num_threads

        # What there is to execute.
        self._events = Events(self.context)
        self._pending_tasks = Tasks(self._events)  # rclpy's `_tasks` is of another type
        self._uses_wait_set = False  # whether rclpy's methods wait, in a wait set

        # The spins.
        self._spins: set[Spin] = set()  # spins that are not over
        self._spins_for_one: list[Spin] = []  # spins whose one callback is to come
        self._never_done = Future()  # of spins without a future
        self._on_future_done = WhenDone(self._events.wake)

        # The threads.
        self._threads: set[Thread] = set()  # daemons, so that a program can end while they spin
        self._standing_by = 0  # number of threads that neither lead nor call a callback
        self._lock = RLock()  # of `_threads` and `_standing_by`
        self._leadership = Leadership()

        notify_of_triggers(self._guard, self._on_change)
        self._closed = False

    def __del__(self) -> None:
        """Release the entities of an executor that was never shut down."""
        # At the interpreter's end, or after the context's, handles may be destroyed already.
        with suppress(InvalidHandle):
            self._close()
        with suppress(InvalidHandle):
            super().__del__()

    def _close(self) -> None:
        """Release all entities and descriptors, unless that has been done."""
        is_closed = getattr(self, '_closed', True)  # missing: its constructor has failed
        self._closed = True
        if is_closed:
            return
        self._wait_to_lead()
        self._events.close()
        self._leadership.close()
        self._pending_tasks.cancel_coroutines()

    def _wait_to_lead(self) -> None:
        while not self._leadership.take():
            time.sleep(_YIELD)

    def _on_change(self) -> None:
        """Refresh the nodes' entities, unless a polling thread does it."""
        self._events.entities_changed = True
        self._events.wake()
        while self._events.entities_changed and not self._is_shutdown and self._leadership.take():
            try:
                self._refresh()
            finally:
                self._leadership.release()

    def _refresh(self) -> None:
        """Listen to the entities of the nodes that are in the executor now."""
        self._events.refresh(self.get_nodes())
        self._pending_tasks.resume_suspended()

    def remove_node(self, node: Node) -> None:
        """Remove a node; after that, another executor can listen to its entities.

        Parameters
        ----------
        node : rclpy.node.Node
            The node; nothing happens if it is not in this executor.
        """
        super().remove_node(node)
        while self._events.listens_to(node):
            if self._is_shutdown or node in self.get_nodes():  # added again by another thread
                break
            self._on_change()
            time.sleep(_YIELD)

    def create_task(self, callback: Callable[..., Any], *args: Any, **kwargs: Any) -> Task:  # noqa: ANN401
        """Execute a function or a coroutine function in the next spin.

        Parameters
        ----------
        callback : callable
            A function, a coroutine function or a coroutine.
        *args, **kwargs
            Arguments of the function.

        Returns
        -------
        rclpy.task.Task
            A future of the result.
        """
        task = Task(callback, args, kwargs, executor=self)
        if isinstance(callback, WhenDone):
            task()
        elif self._uses_wait_set:
            with self._tasks_lock:
                self._tasks.append((task, None, None))
            self.wake()
        else:
            self._pending_tasks.add(task)
        return task

    def _call_task_in_next_spin(self, task: Task) -> None:
        """Step a task whose coroutine yields without a future; rclpy calls this from 7.1.9 on."""
        self._pending_tasks.add(task)

    def wait_for_ready_callbacks(self, *args: Any, **kwargs: Any) -> tuple[Task, Any, Node | None]:  # noqa: ANN401
        """Return a callback that is ready, for a `spin_once` of your own.

        It waits as rclpy's executors do, in a wait set: slower than the methods that spin. Call it
        while none of them runs.

        Parameters
        ----------
        *args, **kwargs
            As in rclpy: `timeout_sec`, `nodes` and `condition`.

        Returns
        -------
        task : rclpy.task.Task
            Calls the callback.
        entity
            The subscription, timer or other entity of the callback; None for a task.
        node : rclpy.node.Node
            The node of the entity; None for a task.

        Raises
        ------
        rclpy.executors.TimeoutException
            No callback was ready within the timeout.
        rclpy.executors.ShutdownException
            The executor was shut down.
        """
        if not (self._uses_wait_set or self._is_shutdown):
            self._use_wait_set()
        ready: tuple[Task, Any, Node | None] = super().wait_for_ready_callbacks(*args, **kwargs)
        return ready

    def _use_wait_set(self) -> None:
        """Leave entities, tasks and triggers to rclpy's own methods until the next spin."""
        self._wait_to_lead()
        try:
            self._uses_wait_set = True
            self._events.refresh([])
            notify_of_triggers(self._guard, None)
            with self._tasks_lock:
                self._tasks.extend(self._pending_tasks.move_out())
        finally:
            self._leadership.release()

    def _use_events(self) -> None:
        """Take entities, tasks and triggers back for a spin."""
        self._uses_wait_set = False
        notify_of_triggers(self._guard, self._on_change)
        self._events.entities_changed = True
        self._cb_iter = None
        with self._tasks_lock:
            tasks = [task for task, _, _ in self._tasks]
            self._tasks.clear()
        for task in tasks:
            self._pending_tasks.add(task)

    def spin(self) -> None:
        """Execute callbacks until the executor or its context is shut down."""
        self._spin(None)

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Execute one callback, or none within the timeout.

        Parameters
        ----------
        timeout_sec : float, optional
            [s] The maximum wait; None or negative: no limit.
        """
        self._spin(timeout_sec, once=True)

    def spin_until_future_complete(self, future: Future, timeout_sec: float | None = None) -> None:
        """Execute callbacks until the future is done or the timeout is over.

        Parameters
        ----------
        future : rclpy.task.Future
            Ends the spin when it is done or cancelled, in any thread.
        timeout_sec : float, optional
            [s] The maximum duration; None or negative: no limit.
        """
        self._spin(timeout_sec, future)

    def spin_once_until_future_complete(
        self, future: Future, timeout_sec: float | TimeoutObject | None = None
    ) -> None:
        """Execute one callback, or none when the future is done or the timeout is over.

        Parameters
        ----------
        future : rclpy.task.Future
            Ends the spin when it is done or cancelled, in any thread.
        timeout_sec : float or rclpy.executors.TimeoutObject, optional
            [s] The maximum wait; None or negative: no limit.
        """
        self._spin(getattr(timeout_sec, 'timeout', timeout_sec), future, once=True)

    def shutdown(self, timeout_sec: float | None = None, *, wait_for_threads: bool = True) -> bool:
        """Stop, wait for the callbacks that have begun, and end the pool's threads.

        Within a callback it returns at once.

        Parameters
        ----------
        timeout_sec : float, optional
            [s] The maximum wait; None or negative: no limit.
        wait_for_threads : bool
            False: return at once.

        Returns
        -------
        bool
            False if callbacks still run: call it again then.
        """
        if not wait_for_threads:
            timeout_sec = 0.0
        self._is_shutdown = True
        self._end_spins()
        self.wake()  # for `wait_for_ready_callbacks`

        with self._lock:
            threads = list(self._threads)
        if current_thread() not in threads:  # else the last thread closes
            if not _join(threads, _deadline(timeout_sec)):
                return False
            self._close()
        while self._events.failures:  # no spin is left to raise them
            traceback.print_exception(self._events.failures.popleft())
        return bool(super().shutdown(timeout_sec))

    def _spin(
        self, timeout_sec: float | None, future: Future | None = None, *, once: bool = False
    ) -> None:
        """Let the pool execute callbacks, because a spin may have to end while one runs."""
        if future is None:
            future = self._never_done
        phase = SpinPhase.ONE_TO_COME if once else SpinPhase.MANY
        spin = Spin(future, _deadline(timeout_sec), phase)
        if self._uses_wait_set:
            self._use_events()
        if not once:  # calls of `spin_once` continue one round of tasks
            self._pending_tasks.polled = True

        future.add_done_callback(self._on_future_done)
        self._spins.add(spin)
        self._is_spinning = True  # for rclpy's `is_spinning`
        try:
            self._events.wake()
            self._start_stand_by()
            self._leadership.wake_stand_by()
            self._wait_until_over(spin)
        finally:
            self._spins.discard(spin)
            self._is_spinning = bool(self._spins)
            future.remove_done_callback(self._on_future_done)  # rclpy does not
            if not once:
                self._pending_tasks.polled = True
            self._events.wake()
            # After the spin no callback may begin: wait until no thread leads.
            while not (self._spins or self._leadership.free):
                time.sleep(_YIELD)
        if self._events.failures:
            raise self._events.failures.popleft()

    def _wait_until_over(self, spin: Spin) -> None:
        """Wait for the end of a spin.

        Within a callback this thread is one of the pool, and leads if no other thread does.
        """
        is_inside = current_thread() in self._threads
        period = _CHECK_PERIOD_INSIDE if is_inside else _CHECK_PERIOD
        while not spin.over.is_set():
            if is_inside and self._leadership.take():
                self._lead(spin)
                continue

            left = spin.deadline - time.monotonic()
            if spin.over.wait(max(1e-3, min(period, left))):
                break
            # A thread that leads, or can lead soon, ends the spin at its deadline.
            can_lead = self._standing_by or not self._leadership.free
            self._end_spins(expired=-inf if can_lead else time.monotonic())

    def _end_spins(self, expired: float = -inf) -> None:
        """End the spins that are done, and those whose deadline is `expired` [s] or earlier."""
        end_all = bool(self._events.failures) or self._is_shutdown or not self.context.ok()
        for spin in list(self._spins):
            if end_all or spin.is_done(expired):
                self._spins.discard(spin)
                spin.over.set()
        if end_all:
            self._events.wake()
            self._leadership.wake_stand_by()

    def _start_stand_by(self, instead: int = 0) -> None:
        """Start a thread in place of `instead` that stood by, unless one does or none is left."""
        with self._lock:
            self._standing_by -= instead
            is_full = len(self._threads) >= self._max_threads
            if not (self._standing_by or self._is_shutdown or is_full):
                self._standing_by += 1
                thread = Thread(target=self._work, daemon=True)
                self._threads.add(thread)
                thread.start()

    def _work(self) -> None:
        """Stand by, and lead when a callback of another thread lasts, until nothing spins."""
        has_lingered = False
        shorten_slices()
        while True:
            with self._lock:
                is_idle = not self._spins
                if is_idle and (has_lingered or self._is_shutdown):
                    self._leave_pool()
                    break
                has_lingered = is_idle
                if is_idle:
                    self._leadership.wake_stand_by(_LINGER)  # another spin may follow
            if is_idle:
                self._leadership.stand_by()
            elif self._leadership.take_over():
                self._start_stand_by(instead=1)
                self._lead()
                with self._lock:
                    self._standing_by += 1
        self._leadership.wake_stand_by()  # for another thread to end

    def _leave_pool(self) -> None:
        """Take this thread out of the pool; the last one closes an executor that is shut down."""
        self._standing_by -= 1
        self._threads.discard(current_thread())
        if self._is_shutdown and not self._threads:
            self._close()

    def _lead(self, within: Spin | None = None) -> None:
        """Poll and execute until all spins, or the one `within` a callback, are over."""
        events = self._events
        tasks = self._pending_tasks

        events.recheck_due = True
        events.poll_due = 0.0
        executed = True
        try:
            while True:
                if events.recheck_due:
                    spins_end = self._recheck(within)
                    if spins_end is None:
                        break
                    deadline = spins_end
                    if events.recheck_due:
                        continue
                    executed = True
                has_work = tasks.ready or (executed and events.ready)
                now = events.poll(0.0 if has_work else deadline)
                tasks.polled = True
                executed = not events.context_ended and self._execute_ready()
                if tasks.ready or now >= deadline:
                    events.recheck_due = True
                if now >= deadline and not (tasks.ready and self._spins_for_one):
                    self._end_spins(expired=now)
        except _LeadershipLost:
            return
        except BaseException as error:  # noqa: BLE001 - the spinning thread raises it
            self._events.fail(error)
        self._leadership.release(0.0 if self._spins or self._is_shutdown else _LINGER)

    def _recheck(self, within: Spin | None) -> float | None:
        """Do what is due outside of a poll, at most one step of a task.

        Returns the earliest deadline [s] of the spins; None: all spins, or the one `within`, are
        over.
        """
        events = self._events
        tasks = self._pending_tasks

        events.recheck_due = False
        self._end_spins()
        spins = list(self._spins)
        if not spins or (within and within.over.is_set()):
            return None

        self._spins_for_one = [spin for spin in spins if spin.phase is SpinPhase.ONE_TO_COME]
        if events.entities_changed:
            self._refresh()

        task = tasks.next_of_round(self.get_nodes()) if tasks else None
        if task:
            self._run(None, (self._step, (task,)))
            events.recheck_due = True  # for the next task of the round
        return min(spin.deadline for spin in spins)

    def _step(self, task: Task) -> None:
        """Run a task until it is done or has to wait."""
        task()
        self._pending_tasks.after_step(task)

    def _step_coroutine(self, entry: Entry, coroutine: Coroutine[Any, Any, Any]) -> None:
        """Run a callback's coroutine until it is done or has to wait: then it is a task."""
        task = Task(_finish(entry, coroutine), executor=self)
        task()
        self._pending_tasks.add(task, entry, stepped=True)

    def _execute_ready(self) -> bool:
        """Execute each entry that is ready once; return whether any was executed."""
        events = self._events
        executed = False
        for _ in range(len(events.ready)):
            entry = events.ready.popleft()
            if not entry.claim.begin():
                events.ready.append(entry)
                continue

            call = self._take(entry)
            if call:
                executed = True
                self._run(entry, call)
                if events.recheck_due:  # the spin may be over
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
            if not entry.is_rclpys_error(error, while_taking=True):
                raise
            entry.warn_of(error)
        finally:
            if call is None:
                entry.claim.end()
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

        Raises _LeadershipLost if another thread has taken over meanwhile.
        """
        callback, arguments = call
        spins = self._spins_for_one
        self._spins_for_one = []
        for spin in spins:
            spin.phase = SpinPhase.ONE_RUNS

        lent = self._leadership.lend(is_lasting=entry is not None and entry.is_slow)
        claimed = entry
        try:
            result = callback(*arguments)
            if result is not None and entry and iscoroutinefunction(callback):
                claimed = None  # the coroutine keeps the group until it is done
                self._step_coroutine(entry, result)
        except BaseException as error:  # noqa: BLE001 - the spinning thread raises it
            self._handle_error(entry, error)
        finally:
            if claimed:  # after `fail`: the spin ends before the next callback of the group
                claimed.claim.end()

        for spin in spins:
            spin.phase = SpinPhase.ONE_RAN
            self._events.recheck_due = True
        leads = self._leadership.take_back(lent)
        if entry:
            entry.is_slow = not leads and time.monotonic() - lent > LASTING
        if not leads:
            self._events.wake()  # its group is free
            raise _LeadershipLost

    def _handle_error(self, entry: Entry | None, error: BaseException) -> None:
        """Warn of an error of rclpy's own code; any other error ends all spins."""
        if entry and entry.is_rclpys_error(error):
            entry.warn_of(error)
        else:
            self._events.fail(error)


def _deadline(timeout_sec: float | None) -> float:
    """Return when a timeout is over [s]; None or negative: never."""
    if timeout_sec is None or timeout_sec < 0:
        return inf
    return time.monotonic() + timeout_sec


def _join(threads: list[Thread], deadline: float) -> bool:
    """Wait for threads to end until the deadline [s]; return whether all have ended."""
    for thread in threads:
        left = deadline - time.monotonic()
        thread.join(None if deadline == inf else max(0.0, left))
    return not any(thread.is_alive() for thread in threads)


async def _finish(entry: Entry, coroutine: Coroutine[Any, Any, Any]) -> None:
    """Await a callback's coroutine, and release its group."""
    try:
        await coroutine
    except Exception as error:
        if not entry.is_rclpys_error(error):
            raise
        entry.warn_of(error)
    finally:
        entry.claim.end()
