"""Counts arrivals for each entity: DDS counts in eventfds, and epoll waits for all of them."""

# ruff: noqa: SLF001 - `rclpy_private` checks rclpy's private names.

from __future__ import annotations

import os
import time
from collections import defaultdict, deque
from contextlib import suppress
from ctypes import c_int32
from functools import partial
from math import inf
from threading import Thread
from typing import TYPE_CHECKING

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from rclpy.event_handler import EventHandler
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, ShutdownException, SingleThreadedExecutor
from rclpy.guard_condition import GuardCondition
from rclpy.timer import Timer

import barc_sim.ros.executor.rclpy_private as private
from barc_sim.ros.executor.entities import KINDS, Entry, entry_of, note_reported
from barc_sim.ros.executor.waiting import Descriptors, counter, retire

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rclpy.context import Context
    from rclpy.node import Node

#: [s] The maximum wait: a signal shuts the context down without an event.
_CHECK_PERIOD = 0.1
#: Uses after which an entity gets a descriptor of its own.
_IDLE_USES = 8
#: [s] between two polls while callbacks are executed without a pause.
_POLL_PERIOD = 0.25e-3
#: Polls without a wait after which arrivals are counted in memory.
_BUSY_POLLS = 16
_ANY_JUMP = JumpThreshold(
    min_forward=Duration(nanoseconds=1), min_backward=Duration(nanoseconds=-1)
)
#: The counters in memory by descriptor; never freed: a listener may fire late, see `retire`.
_counters: defaultdict[int, c_int32] = defaultdict(c_int32)


class Events:
    """The entities of an executor's nodes, and a queue of those with arrivals.

    An entity with a listener is in one of three states, which decide where DDS counts its arrivals:

    ==========  ======================================  ==========
    state       event                                   next state
    ==========  ======================================  ==========
    (new)       it is found in a node of the executor   shared
    shared      an arrival for any such entity          shared; all of them are tried
    shared      it was used `_IDLE_USES` times          own
    own         polls without a wait: `_BUSY_POLLS`     in memory
    in memory   a wait, a check, an entity is removed   own
    all         it or its node is removed               (gone)
    ==========  ======================================  ==========

    "Shared" is one eventfd for all entities that are rarely used, "own" an eventfd of its own, and
    "in memory" a number, without a system call of DDS or the executor. Entities without a listener
    are waited for by `WaitSetThread`: waiting, then queued from its signal to the take.

    `wake` and a check every `_CHECK_PERIOD` set `recheck_due`; the leader clears it, and looks at
    spins, tasks and `entities_changed`, which each change of nodes or entities sets and `refresh`
    clears. Only `wake`, `signal`, `fail` and `listens_to` are for any thread.
    """

    def __init__(self, context: Context) -> None:
        self.ready: deque[Entry] = deque()  #: entries with pending arrivals, the next one first
        self.poll_due = 0.0  #: [s] when epoll is polled, even if an entry is ready
        self.entities_changed = True  #: whether nodes or entities may have been added or removed
        self.recheck_due = True  #: whether the leader has to look at more than arrivals
        self.failures: deque[BaseException] = deque()  #: for the spinning threads to raise
        self.context_ended = False  #: whether a signal ended the context: no callback can publish
        self._entries: dict[object, Entry] = {}
        self._shared = counter()
        self._wakeup = counter()  # counts the resets of timers, too
        self._counted: dict[int, list[Entry]] = {self._wakeup: [], self._shared: []}
        self._in_memory: dict[Entry, int] = {}  # of the arrivals counted in memory, those pending
        self._polls_at_once = 0  # since the last wait
        self._signalled: deque[Entry] = deque()  # by other threads
        self._due: dict[Entry, float] = {}  # [s] by timer; inf: only an event can make it due
        self._next_due = inf
        self._next_check = 0.0
        self._context = context
        self._waiter = WaitSetThread(context, self)
        self._descriptors = Descriptors()
        for descriptor in self._counted:
            self._descriptors.add(descriptor)

    def wake(self, _: object = None) -> None:
        """End a wait; any thread may call this, even after `close`."""
        self.recheck_due = True
        os.eventfd_write(self._wakeup, 1)

    def signal(self, entry: Entry) -> None:
        """Add an arrival to an entry, unless one waits already."""
        self._signalled.append(entry)
        self.wake()

    def fail(self, error: BaseException) -> None:
        """End all spins; one of them raises the error."""
        self.failures.append(error)
        self.wake()

    def queue(self, entry: Entry, count: int = 1) -> None:
        """Add `count` arrivals to an entry, and queue it."""
        if not entry.pending:
            self.ready.append(entry)
        entry.pending += count

    def poll(self, deadline: float) -> float:
        """Wait for an arrival, a `wake` or the deadline [s]; return the time [s].

        A deadline of 0 means that an entry is ready: do not wait.
        """
        now = time.monotonic()
        ready_before = len(self.ready)
        for entry, counted in self._in_memory.items():
            arrived = entry.in_memory.value - counted
            if arrived:
                self._in_memory[entry] += arrived
                self.queue(entry, arrived)
                deadline = 0.0
        if not deadline and now < self.poll_due and now < self._next_due:
            return now

        self.poll_due = now + _POLL_PERIOD
        descriptors = self._descriptors.ready()
        self._polls_at_once += 1
        if not descriptors and now < deadline and now < self._next_due:
            self._polls_at_once = 0
            self._count_in_descriptors()
            descriptors = self._descriptors.wait(min(deadline, self._next_due, now + _CHECK_PERIOD))
            now = time.monotonic()

        for descriptor in descriptors:
            self._queue_counted(descriptor)
            if self._polls_at_once > _BUSY_POLLS:
                self._count_in_memory(descriptor)
        if now >= self._next_due:
            self._schedule([timer for timer, due in self._due.items() if due <= now])
        self._sort_new(len(self.ready) - ready_before)

        self.context_ended = not self._context.handle.ok()
        if self.context_ended or now >= self._next_check:
            self._next_check = now + _CHECK_PERIOD
            self._count_in_descriptors()  # from now on, other entities may be busy
            self.recheck_due = True
        return now

    def _sort_new(self, count: int) -> None:
        """Bring the last entries that are ready into the order in which rclpy executes kinds."""
        if count > 1:
            new = [self.ready.pop() for _ in range(count)]
            new.reverse()
            new.sort(key=lambda entry: KINDS.index(entry.kind))
            self.ready.extend(new)

    def _queue_counted(self, descriptor: int) -> None:
        """Queue the entries whose arrivals a descriptor has counted."""
        count = self._descriptors.take_count(descriptor)
        if count:
            for entry in self._counted[descriptor]:
                self.queue(entry, count)

        if descriptor == self._wakeup:
            while self._signalled:
                entry = self._signalled.popleft()
                if self._entries.get(entry.entity) is entry and not entry.pending:
                    self.queue(entry)
            self._schedule(list(self._due))  # a timer may be reset, or a clock have jumped

    def _count_in_memory(self, descriptor: int) -> None:
        """Count an entity's arrivals in memory, if it has a descriptor of its own."""
        for entry in self._counted[descriptor]:
            if descriptor != self._shared:
                entry.in_memory = _counters[descriptor]
                self._in_memory[entry] = 0
                private.set_listener(entry, entry.in_memory)
                self._queue_counted(descriptor)

    def _count_in_descriptors(self) -> None:
        """Count arrivals in descriptors again, so that a thread can wait for them."""
        while self._in_memory:
            entry, counted = self._in_memory.popitem()
            private.set_listener(entry, entry.descriptor)
            left = entry.in_memory.value - counted
            if left:
                os.eventfd_write(entry.descriptor, left)
            entry.in_memory.value = 0

    def _schedule(self, timers: Iterable[Entry]) -> None:
        """Compute when each of these timers is due, and queue the timers that are due now."""
        for entry in timers:
            left = None
            with suppress(InvalidHandle), entry.handle:
                left = entry.handle.time_until_next_call()

            self._due[entry] = inf
            if left is not None and left <= 0:
                if not entry.pending:  # otherwise it waits for its group already
                    self.queue(entry)
            elif left and not getattr(entry.entity.clock, 'ros_time_is_active', False):
                self._due[entry] = time.monotonic() + left * 1e-9
        self._next_due = min(self._due.values(), default=inf)

    def refresh(self, nodes: Iterable[Node]) -> None:
        """Listen to all entities of the nodes, and to no others."""
        self.entities_changed = False  # first, so that no change from here on is missed
        present = {
            entity: (kind, node)
            for node in nodes
            for kind in KINDS
            for entity in getattr(node, kind)
            if not getattr(entity.callback_group, 'polled', False)
        }

        for entity in self._entries.keys() - present.keys():
            self._remove(self._entries[entity])
            del self._entries[entity]
        for entity, (kind, node) in present.items():
            if entity not in self._entries:
                with suppress(InvalidHandle):  # destroyed just now
                    self._add(entry_of(entity, kind, node))

    def listens_to(self, node: Node) -> bool:
        """Return whether entities of a node are listened to."""
        return any(entry.node is node for entry in list(self._entries.values()))

    def _add(self, entry: Entry) -> None:
        """Listen to an entity."""
        entity = entry.entity
        if isinstance(entity, Timer):
            entry.descriptor = self._wakeup
            private.set_listener(entry, self._wakeup)
            entry.on_taken = lambda entry: self._schedule([entry])
            entry.kept = entity.clock.create_jump_callback(_ANY_JUMP, post_callback=self.wake)
            self._schedule([entry])
        elif isinstance(entity, GuardCondition):
            private.notify_of_triggers(entity, partial(self.signal, entry))
            # rclpy's executors note a trigger before they execute it.
            if private.was_triggered(entity, entry.node.context) or entity._executor_triggered:
                entity._executor_triggered = False
                self.signal(entry)
        else:
            self._add_arrivals(entry)
        self._entries[entity] = entry

    def _add_arrivals(self, entry: Entry) -> None:
        """Listen to an entity for which the middleware has arrivals."""
        entity = entry.entity
        arrived = getattr(entity, '_arrived', 0)  # its last executor did not take them

        if isinstance(entity, EventHandler):
            had_event = note_reported(entry)
            if arrived:
                entry.reported = entity._reported
            arrived = arrived or int(had_event)

        if private.set_listener(entry, self._shared):
            entry.descriptor = self._shared
            entry.idle_uses = _IDLE_USES
            self._counted[self._shared].append(entry)
        else:
            entry.on_taken = self._resume_wait
            self._waiter.add(entry)

        if arrived:
            self.queue(entry, arrived)

    def _resume_wait(self, entry: Entry) -> None:
        """Wait for an entity in the wait set again, unless it is ready already.

        The thread with the wait set may be late: a goal's result must not overtake the feedback.
        """
        if entry.kind == 'waitables' and private.is_ready(entry.entity, self._context):
            self.queue(entry)
        else:
            self._waiter.resume(entry)

    def note_use(self, entry: Entry) -> None:
        """Count a use of an entity that shares a descriptor; the last one gives it its own."""
        entry.idle_uses -= 1
        if not entry.idle_uses:
            with suppress(OSError):  # no descriptor is left
                descriptor = counter()
                private.set_listener(entry, descriptor)
                self._leave(entry)
                entry.descriptor = descriptor
                self._counted[descriptor] = [entry]
                self._descriptors.add(descriptor)

    def _leave(self, entry: Entry) -> None:
        """Stop counting an entity's arrivals in its descriptor."""
        descriptor = entry.descriptor
        self._queue_counted(descriptor)
        self._counted[descriptor].remove(entry)
        if descriptor != self._shared:
            del self._counted[descriptor]
            self._descriptors.remove(descriptor)
            retire(descriptor)

    def _remove(self, entry: Entry) -> None:
        """Stop listening to an entity."""
        entity = entry.entity
        self._count_in_descriptors()
        if isinstance(entity, GuardCondition):
            private.notify_of_triggers(entity, None)
            with suppress(InvalidHandle):
                if entry.pending or entry in self._signalled:
                    entity.trigger()  # for its next executor
        elif entry.descriptor < 0:
            self._waiter.remove(entry)
        else:
            private.set_listener(entry, None)
            if isinstance(entity, Timer):
                del self._due[entry]
                with suppress(InvalidHandle):  # the clock is destroyed
                    entry.kept.unregister()
            else:
                self._leave(entry)
                entity._arrived = entry.pending  # for its next executor
                entity._reported = entry.reported

        with suppress(ValueError):  # it is not queued
            self.ready.remove(entry)

    def close(self) -> None:
        """Stop listening to all entities."""
        self.refresh([])
        self._waiter.close()
        retire(self._wakeup)
        retire(self._shared)
        self._descriptors.close()


class WaitSetThread(SingleThreadedExecutor):
    """Waits for entities without a listener, in rclpy's own wait set.

    It starts with the first entry. It signals each entry that is ready, and waits for that entry
    again after `resume`. An exception of a waitable ends it, and all spins.
    """

    def __init__(self, context: Context, events: Events) -> None:
        super().__init__(context=context)
        self._events = events
        self._thread = Thread(target=self._run, daemon=True)
        for kind in KINDS:  # rclpy waits for these entities as for those of a node
            setattr(self, kind, [])

    def add(self, entry: Entry) -> None:
        """Wait for an entry from now on, even while its callback group is claimed."""
        group = ReentrantCallbackGroup()
        entry.kept = private.StandIn(
            entry.entity, entry=entry, callback_group=group, _executor_event=False
        )
        getattr(self, entry.kind).append(entry.kept)
        self.wake()
        if not self._thread.ident:
            self._thread.start()

    def resume(self, entry: Entry) -> None:
        """Wait for an entry again, after its take."""
        entry.kept._executor_event = False  # True from ready to taken
        self.wake()

    def remove(self, entry: Entry) -> None:
        """Stop waiting for an entry."""
        getattr(self, entry.kind).remove(entry.kept)
        self.wake()

    def close(self) -> None:
        """End the thread."""
        self._is_shutdown = True
        self.wake()
        if self._thread.ident:
            self._thread.join()
        with suppress(InvalidHandle):  # destroyed already, at the interpreter's end
            self.shutdown()
        self._sigint_gc = None

    def _run(self) -> None:
        try:
            with suppress(ShutdownException, ExternalShutdownException):
                while True:
                    for task, waited, _ in self._wait_for_ready_callbacks(None, [self]):
                        if not task.cancelled():  # rclpy returns those of the last wait, too
                            task.cancel()
                            self._events.signal(waited.entry)
        except BaseException as error:  # noqa: BLE001 - the spinning thread raises it
            self._events.fail(error)
