"""What has arrived for each entity: DDS counts it in eventfds, and epoll waits for all of them."""

# ruff: noqa: SLF001 - `rclpy_private` checks rclpy's private names.

from __future__ import annotations

import time
import warnings
from collections import deque
from contextlib import suppress
from functools import partial
from threading import Lock
from typing import TYPE_CHECKING

from rclpy.action import ActionServer
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.event_handler import EventHandler
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rclpy.waitable import Waitable

from barc_sim.errors import UserError
from barc_sim.ros.executor.callback_groups import PolledCallbackGroup
from barc_sim.ros.executor.descriptors import Descriptors, add_to, counter, retire
from barc_sim.ros.executor.entities import (
    KINDS,
    Entity,
    Entry,
    action_is_ready,
    take_of,
    take_waitable,
)
from barc_sim.ros.executor.rclpy_private import (
    handle_of,
    note_destruction,
    notify_of_triggers,
    reset_trigger,
    set_listener,
)
from barc_sim.ros.executor.timers import Timers
from barc_sim.ros.executor.wait_set import WaitSetThread

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rclpy.context import Context
    from rclpy.node import Node

#: [s] The longest wait. Then the context is checked, as a signal ends it without an event, and
#: action servers, whose results expire without one.
_CHECK_PERIOD = 0.1
#: What shares a descriptor while it is idle: so many at most, until each has been used so often.
_SHARING = (Subscription, Service, EventHandler)
_SHARED = 32
_IDLE_USES = 8


def _claiming(entity: Entity) -> tuple[Callable[[], bool], Callable[[], None]]:
    """Return what claims the entity's group, where that allows it, and what gives it back.

    For rclpy's own groups the same as theirs, without their checks, which take 2 us.
    """
    group = entity.callback_group
    if type(group) is ReentrantCallbackGroup:
        return lambda: True, lambda: None
    if type(group) is not MutuallyExclusiveCallbackGroup:
        begin = partial(group.beginning_execution, entity)
        return (
            lambda: group.can_execute(entity) and begin(),
            partial(group.ending_execution, entity),
        )
    lock = group._lock

    def claim() -> bool:
        with lock:
            if group._active_entity is None:
                group._active_entity = entity
                return True
        return False

    def give_back() -> None:
        group._active_entity = None

    return claim, give_back


class Events:
    """The entities of an executor's nodes, and which of them something has arrived for.

    A subscription or service that is hardly used shares its descriptor: when something arrives for
    one, all of them are tried. After a few uses it gets a descriptor of its own.

    All but `wake` is for one thread at a time. An entity's handle stays in use until `refresh`
    finds it gone, so that its listener is taken back before it is destroyed. `on_failure` is
    called in the wait set's thread with an exception of a waitable.
    """

    def __init__(self, context: Context, on_failure: Callable[[BaseException], None]) -> None:
        self.ready: deque[Entry] = deque()  #: entries with something pending, in turn
        self.now = 0.0  #: [s] when it was polled last
        self.stale = True  #: whether the nodes are to be looked at again
        self.woken = True  #: whether `wake` was called, or it is time for a check
        self._entries: dict[Entity, Entry] = {}
        self._by_descriptor: dict[int, Entry] = {}
        self._shared: dict[int, list[Entry]] = {}  # by descriptor
        self._signalled: deque[Entry] = deque()  # by other threads
        self._jumped = False
        self._next_check = 0.0
        self._wakeup = counter()
        self._wakeup_lock = Lock()
        self._wakeup_is_set = False  # also once it is closed
        self._timers = Timers(self.queue, self._on_jump)
        self._waiter = WaitSetThread(context, self._signal, on_failure)
        self._descriptors = Descriptors()
        self._special = {
            self._wakeup: self._on_wake,
            self._timers.descriptor: self._timers.expire,
            self._timers.resets: self._on_reset,
        }
        for descriptor in self._special:
            self._descriptors.add(descriptor)

    def wake(self) -> None:
        """End a wait, from any thread, also when this is closed."""
        self.woken = True
        with self._wakeup_lock:
            if not self._wakeup_is_set:
                self._wakeup_is_set = True
                add_to(self._wakeup, 1)

    def queue(self, entry: Entry, count: int = 1) -> None:
        """Note that something has arrived for an entity."""
        entry.pending += count
        if not entry.queued:
            entry.queued = True
            entry.found = self.now
            self.ready.append(entry)

    def poll(self, deadline: float) -> float:
        """Wait until something arrives, `wake` is called or the deadline [s]; return the time."""
        self.now = now = time.monotonic()
        descriptors = self._descriptors.ready()
        if not descriptors and deadline > now:
            descriptors = self._descriptors.wait(min(deadline - now, _CHECK_PERIOD))
        for descriptor in descriptors:
            entry = self._by_descriptor.get(descriptor)
            if entry is not None:
                self.queue(entry, self._descriptors.take_count(descriptor))
            elif descriptor in self._shared:
                self._try_all(descriptor)
            else:
                self._special[descriptor]()
        if descriptors and len(self.ready) > 1:
            self._sort()
        if now >= self._next_check:
            self._next_check = now + _CHECK_PERIOD
            self.woken = True
            for entry in self._entries.values():
                if isinstance(entry.entity, ActionServer):
                    with suppress(InvalidHandle):  # destroyed just now
                        if action_is_ready(entry):
                            self.queue(entry)
        return now

    def _sort(self) -> None:
        """Sort what is ready as rclpy does; but none is executed twice before another one."""
        oldest = min(entry.found for entry in self.ready)

        def turn(entry: Entry) -> tuple[float, int]:
            again = entry.executed if entry.executed >= oldest else 0.0
            return again, KINDS.index(entry.kind)

        turns = sorted(self.ready, key=turn)
        self.ready.clear()
        self.ready.extend(turns)

    def _signal(self, entry: Entry) -> None:
        self._signalled.append(entry)
        self.wake()

    def _on_jump(self) -> None:
        self._jumped = True
        self.wake()

    def _on_wake(self) -> None:
        with self._wakeup_lock:
            self._descriptors.take_count(self._wakeup)
            self._wakeup_is_set = False
        while self._signalled:
            entry = self._signalled.popleft()
            if self._entries.get(entry.entity) is entry and not entry.pending:
                self.queue(entry)
        if self._jumped:
            self._jumped = False
            self._timers.schedule_all()

    def _on_reset(self) -> None:
        self._descriptors.take_count(self._timers.resets)
        self._timers.schedule_all()

    def refresh(self, nodes: Iterable[Node]) -> None:
        """Listen to all entities of the nodes, and to no others."""
        self.stale = False  # before the nodes are looked at, so that no later change is missed
        found = {
            entity: (kind, node)
            for node in nodes
            for kind in KINDS
            for entity in getattr(node, kind)
            if not isinstance(entity.callback_group, PolledCallbackGroup)
        }
        for entity in self._entries.keys() - found.keys():
            self.remove(entity)
        for entity, (kind, node) in found.items():
            if entity not in self._entries:
                with suppress(InvalidHandle):  # destroyed just now
                    self._add(entity, kind, node)

    def _add(self, entity: Entity, kind: str, node: Node) -> None:
        handle, take = handle_of(entity), take_of(entity)
        handle.__enter__()
        entry = Entry(entity, kind, node, handle, take, *_claiming(entity))
        self._entries[entity] = entry
        if isinstance(entity, Timer):
            entry.on_taken = self._timers.schedule
            self._timers.add(entry)
        elif isinstance(entity, GuardCondition):
            notify_of_triggers(entity, partial(self._signal, entry))
            if reset_trigger(entity, node.context):
                self._signal(entry)
        elif not self._listen(entry):
            if isinstance(entity, Waitable):
                entry.take = take_waitable
            else:
                warnings.warn('the middleware has no listeners: wait sets are slow', stacklevel=2)
            entry.on_taken = self._waiter.resume
            self._waiter.add(entry)

    def _listen(self, entry: Entry) -> bool:
        """Have arrivals counted; return False where there are no listeners."""
        if isinstance(entry.entity, _SHARING):
            entry.idle_uses = _IDLE_USES
        if not self._count_arrivals(entry):
            return False
        if isinstance(entry.entity, (Subscription, Service)):
            note_destruction(entry.entity, entry.note_destruction)
        if left := getattr(entry.entity, '_arrived', 0):  # counted, but not taken before
            self.queue(entry, left)
        return True

    def _count_arrivals(self, entry: Entry) -> bool:
        """Count an entity's arrivals in a descriptor: a shared one while it is idle."""
        room = (number for number, sharing in self._shared.items() if len(sharing) < _SHARED)
        descriptor = next(room, None) if entry.idle_uses else None
        if is_new := descriptor is None:
            descriptor = counter()
        if not set_listener(entry.entity, descriptor):
            if is_new:
                retire(descriptor)
            return False
        entry.descriptor = descriptor
        if entry.idle_uses:
            self._shared.setdefault(descriptor, []).append(entry)
        else:
            self._by_descriptor[descriptor] = entry
        if is_new:
            self._descriptors.add(descriptor)
        return True

    def _try_all(self, descriptor: int) -> None:
        """Try each of those that share a descriptor, as something has arrived for one."""
        count = self._descriptors.take_count(descriptor)
        for entry in self._shared[descriptor]:
            self.queue(entry, count)

    def note_use(self, entry: Entry) -> None:
        """Note that something was taken for an idle entity: others may share with it no longer."""
        entry.idle_uses -= 1
        if not entry.idle_uses:
            former = entry.descriptor
            try:
                self._count_arrivals(entry)
            except UserError:  # no descriptor is left
                entry.idle_uses = _IDLE_USES
            else:
                self._leave(entry, former)

    def _leave(self, entry: Entry, descriptor: int) -> None:
        """Count no arrivals of an entity in a descriptor any longer."""
        if descriptor in self._shared:
            self._try_all(descriptor)
            self._shared[descriptor].remove(entry)
            if self._shared[descriptor]:
                return
            del self._shared[descriptor]
        else:
            entry.pending += self._descriptors.take_count(descriptor)
            del self._by_descriptor[descriptor]
        self._descriptors.remove(descriptor)
        retire(descriptor)

    def remove(self, entity: Entity) -> None:
        """Listen to an entity no longer, and let it be destroyed."""
        entry = self._entries.pop(entity)
        if isinstance(entity, Timer):
            self._timers.remove(entry)
        elif isinstance(entity, GuardCondition):
            notify_of_triggers(entity, None)
            with suppress(InvalidHandle):
                reset_trigger(entity, entry.node.context)
                if entry.pending or entry in self._signalled:
                    entity.trigger()  # for its next executor
        elif entry.descriptor < 0:
            self._waiter.remove(entry)
        else:
            set_listener(entity, None)
            if isinstance(entity, (Subscription, Service)):
                note_destruction(entity, None)
            self._leave(entry, entry.descriptor)
            entity._arrived = entry.pending
        with suppress(ValueError):  # it waits for nothing
            self.ready.remove(entry)
        entry.pending = 0
        entry.kept = None
        entry.handle.__exit__(None, None, None)

    def close(self) -> None:
        """Listen to nothing; a second call does nothing."""
        if not self._descriptors.closed:
            self.refresh([])
            self._waiter.close()
            self._timers.close()
            with self._wakeup_lock:
                self._wakeup_is_set = True
                self._descriptors.remove(self._wakeup)
                retire(self._wakeup)
            self._descriptors.close()
