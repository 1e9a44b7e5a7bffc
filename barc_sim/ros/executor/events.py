"""Counts arrivals for each entity: DDS counts in eventfds, and epoll waits for all of them."""

from __future__ import annotations

import os
import time
from collections import defaultdict, deque
from contextlib import suppress
from ctypes import c_int32
from functools import partial
from math import inf
from typing import TYPE_CHECKING, Any

from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from rclpy.event_handler import EventHandler
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.timer import Timer

import barc_sim.ros.executor.rclpy_private as private
from barc_sim.ros.executor.entities import KINDS, Entry
from barc_sim.ros.executor.linux import Descriptors, counter, retire_counter
from barc_sim.ros.executor.rcl import set_listener
from barc_sim.ros.executor.takes import entry_of, note_reported
from barc_sim.ros.executor.wait_set import WaitSetThread

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
#: The counters in memory by descriptor; never freed: a listener may fire late, see
#: `retire_counter`.
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
        self._context = context
        self._entries: dict[object, Entry] = {}

        # Where arrivals are counted.
        self._descriptors = Descriptors()
        self._shared = counter()
        self._wakeup = counter()  # counts the resets of timers, too
        self._counted: dict[int, list[Entry]] = {}  # entries by descriptor
        for descriptor in (self._wakeup, self._shared):
            self._counted[descriptor] = []
            self._descriptors.add(descriptor)
        self._in_memory: dict[Entry, int] = {}  # of the arrivals counted in memory, those pending
        self._polls_at_once = 0  # since the last wait
        self._signalled: deque[Entry] = deque()  # by other threads
        self._wait_set_thread = WaitSetThread(context, self.signal, self.fail)

        self._due: dict[Entry, float] = {}  # [s] by timer; inf: only an event can make it due
        self._next_due = inf
        self._next_check = 0.0

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
        number_before = len(self.ready)
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
        number_new = len(self.ready) - number_before
        if number_new > 1:
            self._sort_new(number_new)

        self.context_ended = not self._context.handle.ok()
        if self.context_ended or now >= self._next_check:
            self._next_check = now + _CHECK_PERIOD
            self._count_in_descriptors()  # from now on, other entities may be busy
            self.recheck_due = True
        return now

    def _sort_new(self, number: int) -> None:
        """Bring the last entries of the queue into rclpy's order."""
        new = [self.ready.pop() for _ in range(number)]
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
        if descriptor == self._shared:
            return
        for entry in self._counted[descriptor]:
            entry.in_memory = _counters[descriptor]
            self._in_memory[entry] = 0
            set_listener(entry, entry.in_memory)
            self._queue_counted(descriptor)

    def _count_in_descriptors(self) -> None:
        """Count arrivals in descriptors again, so that a thread can wait for them."""
        while self._in_memory:
            entry, counted = self._in_memory.popitem()
            set_listener(entry, entry.descriptor)
            left = entry.in_memory.value - counted
            if left:
                os.eventfd_write(entry.descriptor, left)
            entry.in_memory.value = 0

    def _schedule(self, timers: Iterable[Entry]) -> None:
        """Compute when each of these timers is due, and queue the timers that are due now."""
        for entry in timers:
            left: int | None = None  # [ns]; None: it is cancelled
            with suppress(InvalidHandle), entry.handle:
                left = entry.handle.time_until_next_call()

            self._due[entry] = inf
            if left is None:
                continue
            if left <= 0:
                if not entry.pending:  # otherwise it waits for its group already
                    self.queue(entry)
            elif not getattr(entry.entity.clock, 'ros_time_is_active', False):
                self._due[entry] = time.monotonic() + left * 1e-9
        self._next_due = min(self._due.values(), default=inf)

    def _schedule_one(self, timer: Entry) -> None:
        self._schedule([timer])

    def refresh(self, nodes: Iterable[Node]) -> None:
        """Listen to all entities of the nodes, and to no others."""
        self.entities_changed = False  # first, so that no change from here on is missed
        present: dict[Any, tuple[str, Node]] = {}
        for node in nodes:
            for kind in KINDS:
                for entity in getattr(node, kind):
                    if not getattr(entity.callback_group, 'polled', False):
                        present[entity] = (kind, node)

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
        if isinstance(entry.entity, Timer):
            self._add_timer(entry)
        elif isinstance(entry.entity, GuardCondition):
            self._add_guard_condition(entry)
        else:
            self._add_receiver(entry)
        self._entries[entry.entity] = entry

    def _add_timer(self, entry: Entry) -> None:
        timer = entry.entity
        entry.descriptor = self._wakeup
        set_listener(entry, self._wakeup)  # called when it is reset
        entry.on_taken = self._schedule_one
        entry.jump_handle = timer.clock.create_jump_callback(_ANY_JUMP, post_callback=self.wake)
        self._schedule([entry])

    def _add_guard_condition(self, entry: Entry) -> None:
        private.notify_of_triggers(entry.entity, partial(self.signal, entry))
        if private.take_early_trigger(entry.entity, entry.node.context):
            self.signal(entry)

    def _add_receiver(self, entry: Entry) -> None:
        """Listen to an entity for which the middleware has arrivals."""
        leftover = private.leftover_in(entry.entity)
        arrived = leftover.arrivals
        if isinstance(entry.entity, EventHandler):
            had_event = note_reported(entry)
            if arrived:
                entry.reported = leftover.reported
            elif had_event:
                arrived = 1

        if set_listener(entry, self._shared):
            entry.descriptor = self._shared
            entry.idle_uses = _IDLE_USES
            self._counted[self._shared].append(entry)
        else:
            entry.on_taken = self._resume_wait
            self._wait_set_thread.add(entry)
        if arrived:
            self.queue(entry, arrived)

    def _resume_wait(self, entry: Entry) -> None:
        """Wait for an entity in the wait set again, unless it is ready already.

        The thread with the wait set may be late: a goal's result must not overtake the feedback.
        """
        if entry.kind == 'waitables' and private.is_ready(entry.entity, self._context):
            self.queue(entry)
        else:
            self._wait_set_thread.resume(entry)

    def note_use(self, entry: Entry) -> None:
        """Count a use of an entity that shares a descriptor; the last one gives it its own."""
        entry.idle_uses -= 1
        if entry.idle_uses:
            return
        with suppress(OSError):  # no descriptor is left
            descriptor = counter()
            set_listener(entry, descriptor)
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
            retire_counter(descriptor)

    def _remove(self, entry: Entry) -> None:
        """Stop listening to an entity."""
        self._count_in_descriptors()
        if isinstance(entry.entity, Timer):
            self._remove_timer(entry)
        elif isinstance(entry.entity, GuardCondition):
            self._remove_guard_condition(entry)
        elif entry.descriptor < 0:
            self._wait_set_thread.remove(entry)
        else:
            set_listener(entry, None)
            self._leave(entry)
            leftover = private.Leftover(arrivals=entry.pending, reported=entry.reported)
            private.leave(entry.entity, leftover)
        with suppress(ValueError):  # it is not queued
            self.ready.remove(entry)

    def _remove_timer(self, entry: Entry) -> None:
        set_listener(entry, None)
        del self._due[entry]
        with suppress(InvalidHandle):  # the clock is destroyed
            entry.jump_handle.unregister()

    def _remove_guard_condition(self, entry: Entry) -> None:
        private.notify_of_triggers(entry.entity, None)
        with suppress(InvalidHandle):
            if entry.pending or entry in self._signalled:
                entry.entity.trigger()  # for its next executor

    def close(self) -> None:
        """Stop listening to all entities."""
        self.refresh([])
        self._wait_set_thread.close()
        retire_counter(self._wakeup)
        retire_counter(self._shared)
        self._descriptors.close()
