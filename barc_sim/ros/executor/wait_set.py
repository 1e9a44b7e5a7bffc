"""What an executor waits for, kept until the graph changes."""

# ruff: noqa: SLF001 - rclpy's private names are the point; `executor_private` checks them.

from __future__ import annotations

from contextlib import ExitStack, suppress
from dataclasses import dataclass
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeAlias

from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, ShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.waitable import NumberOfEntities

from barc_sim.ros.executor.rclpy_private import KINDS

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from rclpy.context import Context
    from rclpy.guard_condition import GuardCondition
    from rclpy.node import Node

#: A timer, subscription, …: rclpy's have no type in common.
Entity: TypeAlias = Any
#: What to await when an entity was taken: its callback, with what was there for it.
Execute: TypeAlias = 'Callable[[], Awaitable[None]]'

#: Times that the nodes are looked at while others destroy what is in them.
_ATTEMPTS = 100


@dataclass(frozen=True, eq=False)
class Entry:
    """An entity to wait for, how it is put into the wait set and how it is taken when ready."""

    entity: Entity
    node: Node
    add: Callable[[Any], object]
    argument: Any
    take: Callable[[Any, Entity], Execute | None]


class WaitList:
    """The entities of an executor's nodes, in a wait set that is used again and again.

    Their handles stay in use until `invalidate` is called, so that none is destroyed while it
    is waited for. Only one thread may wait at a time.
    """

    def __init__(self) -> None:
        self._stale = True
        self._refused: set[Entry] = set()  # found ready, but not to be executed
        self._left_out: set[Entry] = set()  # of this wait
        self._passed_over: dict[Entry, None] = {}  # refused since executed; longest ago first
        self._in_use = Lock()  # held while the wait set is filled and waited for
        self._held = ExitStack()
        self._wait_set: Any = None
        self._own: list[Any] = []
        self._entries: list[Entry] = []
        self._waitables: list[Entry] = []
        self._by_pointer: dict[int, Entry] = {}  # by what a wait set reports, without waitables
        self._kinds: list[str] = []

    def invalidate(self) -> None:
        """Forget the entities, as the graph has changed; ending a wait is for the caller."""
        self._stale = True
        if self._in_use.acquire(blocking=False):
            try:
                self._release()
            finally:
                self._in_use.release()

    def wait(self, executor: MultiThreadedExecutor, timeout_nsec: int) -> list[Entry]:
        """Wait until something is ready, the executor is woken or the time is over.

        What was refused before comes first, so that none keeps others of its group out.
        """
        with self._in_use:
            try:
                self._prepare(executor)
                self._wait_set.wait(timeout_nsec)
                if executor._is_shutdown:
                    raise ShutdownException
                if not executor.context.ok():
                    raise ExternalShutdownException
                return self._ready()
            finally:
                if self._stale:
                    self._release()

    def take(self, executor: MultiThreadedExecutor, entry: Entry) -> Execute | None:
        """Claim the entity's group and take what is there; None where either can't be had."""
        entity, group = entry.entity, entry.entity.callback_group
        if not (executor.can_execute(entity) and group.beginning_execution(entity)):
            self._refused.add(entry)
            self._passed_over.setdefault(entry)
            return None
        self._passed_over.pop(entry, None)
        execute = None
        try:
            execute = entry.take(executor, entity)
        finally:
            if execute is None:
                group.ending_execution(entity)
        return execute

    def _release(self) -> None:
        self._wait_set = None
        self._entries, self._waitables, self._by_pointer = [], [], {}
        self._refused, self._passed_over = set(), {}
        self._held.close()

    def _refresh(self, executor: MultiThreadedExecutor) -> None:
        self._release()
        self._stale = False  # before the graph is read, so that no later change is missed
        guards = (executor._guard, executor._sigint_gc)
        if None in guards:
            raise ShutdownException
        self._own = [guard.handle for guard in guards]
        with ExitStack() as stack:
            for handle in (executor.context.handle, *self._own):
                stack.enter_context(handle)
            found = _found(executor, stack)
            self._wait_set = _wait_set(found, len(self._own), executor.context)
            self._held = stack.pop_all()
        self._kinds = [kind for kind in KINDS if kind in {each[0] for each in found}]
        for kind, entity, node in found:
            entry = self._entry(kind, entity, node)
            self._entries.append(entry)
            if kind == 'waitable':
                self._waitables.append(entry)
            else:
                self._by_pointer[entity.handle.pointer] = entry

    def _entry(self, kind: str, entity: Entity, node: Node) -> Entry:
        take = _take_timer if kind == 'timer' else getattr(MultiThreadedExecutor, f'_take_{kind}')
        if kind == 'waitable':
            return Entry(entity, node, entity.add_to_wait_set, self._wait_set, take)
        if kind == 'guard_condition':
            return Entry(entity, node, self._add_guard_condition, entity, take)
        return Entry(entity, node, getattr(self._wait_set, f'add_{kind}'), entity.handle, take)

    def _prepare(self, executor: MultiThreadedExecutor) -> None:
        for left in reversed(range(_ATTEMPTS)):
            try:
                if self._stale:
                    self._refresh(executor)
                self._fill(executor)
                break
            except (InvalidHandle, _rclpy.RCLError):  # one was destroyed just now, or has grown
                self._stale = True
                if not left:
                    raise

    def _fill(self, executor: MultiThreadedExecutor) -> None:
        # Only these: to ask all whether they can be executed would take longer than the wait.
        self._refused = {each for each in self._refused if not executor.can_execute(each.entity)}
        # Fast DDS ends a wait for a subscription's events at once where messages wait, too.
        events = {it for each in self._refused for it in getattr(each.entity, 'event_handlers', ())}
        self._left_out = self._refused | {it for it in self._waitables if it.entity in events}
        self._wait_set.clear_entities()
        for entry in self._entries:
            if entry not in self._left_out:
                entry.add(entry.argument)
        for handle in self._own:
            self._wait_set.add_guard_condition(handle)

    def _add_guard_condition(self, guard: GuardCondition) -> None:
        if guard._executor_triggered:  # it was ready once, but not executed
            guard.trigger()
        self._wait_set.add_guard_condition(guard.handle)

    def _ready(self) -> list[Entry]:
        waitables = (each for each in self._waitables if each not in self._left_out)
        ready = [each for each in waitables if each.entity.is_ready(self._wait_set)]
        for kind in self._kinds:
            for pointer in self._wait_set.get_ready_entities(kind):
                entry = self._by_pointer.get(pointer)
                if entry is None:  # the executor's own, or a part of a waitable
                    continue
                if kind == 'guard_condition':
                    entry.entity._executor_triggered = True
                ready.append(entry)
        if self._passed_over:
            first = [each for each in self._passed_over if each in ready]
            ready = first + [each for each in ready if each not in first]
        return ready


def _found(executor: MultiThreadedExecutor, stack: ExitStack) -> list[tuple[str, Entity, Node]]:
    """Return the kind, entity and node of all that the stack now keeps from being destroyed."""
    found = []
    for node in executor.get_nodes():
        for kind in ('waitable', *KINDS):
            for entity in getattr(node, 'guards' if kind == 'guard_condition' else f'{kind}s'):
                with suppress(InvalidHandle):  # destroyed
                    stack.enter_context(entity if kind == 'waitable' else entity.handle)
                    found.append((kind, entity, node))
    return found


def _wait_set(found: list[tuple[str, Entity, Node]], guards: int, context: Context) -> Any:  # noqa: ANN401
    number = NumberOfEntities(num_gcs=guards)
    for kind, entity, _ in found:
        if kind == 'waitable':
            number += entity.get_num_entities()
        else:
            setattr(number, f'num_{kind}s', getattr(number, f'num_{kind}s') + 1)
    counts = (getattr(number, name) for name in number.__slots__)
    return _rclpy.WaitSet(*counts, context.handle)


def _take_timer(executor: MultiThreadedExecutor, timer: Entity) -> Execute | None:
    """Take a timer as rclpy does, unless it was cancelled since it was ready."""
    execute: Execute | None = None
    try:
        with suppress(InvalidHandle), timer.handle:
            if timer.handle.is_timer_ready():
                execute = executor._take_timer(timer)
    except _rclpy.RCLError:
        if not timer.is_canceled():
            raise
    return execute
