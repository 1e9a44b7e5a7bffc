"""Callbacks on their way through an executor: each is called once, and none is lost."""

# ruff: noqa: SLF001 - `executor_private` checks rclpy's private names.

from __future__ import annotations

from collections import deque
from threading import Condition, get_ident
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine
    from concurrent.futures import ThreadPoolExecutor

    from rclpy.task import Task

    from barc_sim.ros.executor.wait_set import Entry, Execute


class Callback:
    """A callback whose group is claimed and whose message is taken, to be called once.

    Where it is a coroutine that waits for something, its rest goes to `resume_later`. Where it
    was handed off, its entity is waited for again as soon as it begins, with `trigger`.
    """

    def __init__(
        self,
        entry: Entry,
        execute: Execute,
        trigger: Callable[[], None],
        resume_later: Callable[[Coroutine[Any, Any, None], Entry], None],
    ) -> None:
        self._entry = entry
        self._entity = entry.entity
        self._execute = execute
        self._trigger = trigger
        self._resume_later = resume_later

    def __call__(self) -> None:
        """Call it."""
        entity = self._entity
        if entity._executor_event:
            entity._executor_event = False
            if entity.callback_group.can_execute(entity):
                self._trigger()
        coroutine = self._run()
        try:
            coroutine.send(None)
        except StopIteration:
            return
        self._resume_later(coroutine, self._entry)

    async def _run(self) -> None:
        try:
            await self._execute()
        finally:
            self._entity.callback_group.ending_execution(self._entity)

    def hand_off(self) -> None:
        """Keep the entity from being waited for until the callback begins."""
        self._entity._executor_event = True

    def drop(self) -> None:
        """Give the group back without a call, as the executor was shut down."""
        self._entity._executor_event = False
        self._entity.callback_group.ending_execution(self._entity)


class Pool:
    """The threads that execute callbacks: the spinning one, and those of a pool.

    A handler is a `Callback`, or rclpy's `Task`, which is called step by step where it waits.
    """

    def __init__(self) -> None:
        self.failures: deque[BaseException] = deque()
        self._woken: dict[Callback | Task, bool] = {}  # handlers in the pool: True to step again
        self._busy: set[int] = set()  # threads that execute a callback
        self._changed = Condition()  # guards _woken; notified as callbacks end
        self._closed = False

    def __contains__(self, handler: Callback | Task) -> bool:
        """Whether the handler waits for a thread of the pool or runs in one."""
        return handler in self._woken

    def run_here(self, handler: Callback | Task) -> None:
        """Call the handler in this thread."""
        self._busy.add(get_ident())
        try:
            _step(handler)
        finally:
            self._busy.discard(get_ident())
            if self._closed:
                with self._changed:
                    self._changed.notify_all()

    def submit(
        self, handler: Callback | Task, threads: ThreadPoolExecutor, trigger: Callable[[], None]
    ) -> None:
        """Call the handler in a thread of the pool, and `trigger` when it has ended."""
        with self._changed:
            if handler in self._woken or (self._closed and _drop(handler)):
                return
            self._woken[handler] = False
            if isinstance(handler, Callback):
                handler.hand_off()
            threads.submit(self._run, handler, trigger)

    def _run(self, handler: Callback | Task, trigger: Callable[[], None]) -> None:
        self._busy.add(get_ident())
        finished = again = True
        try:
            while again:
                finished = _drop(handler) if self._closed else _step(handler)
                with self._changed:
                    again = self._woken[handler] and not finished
                    self._woken[handler] = False
                    if not again:
                        del self._woken[handler]
        except BaseException as error:  # noqa: BLE001 - the spinning thread raises it
            self.failures.append(error)
            self._woken.pop(handler)
        finally:
            self._busy.discard(get_ident())
            if self._closed:
                with self._changed:
                    self._changed.notify_all()
            if finished:  # its group is free, or it is to be raised
                trigger()

    def wake(self) -> None:
        """Step again whatever is being stepped: what it waits for may have come meanwhile."""
        if self._woken:
            with self._changed:
                self._woken.update(dict.fromkeys(self._woken, True))

    def inside(self) -> bool:
        """Whether this thread executes a callback."""
        return get_ident() in self._busy

    def close(self, timeout_sec: float | None) -> bool:
        """Begin no further callback in the pool; return whether all ended within the time."""
        with self._changed:
            self._closed = True
            return self._changed.wait_for(lambda: not (self._woken or self._busy), timeout_sec)


def _step(handler: Callback | Task) -> bool:
    """Call it; return False where it is a coroutine that waits for something."""
    handler()
    if isinstance(handler, Callback):
        return True
    if handler.done():
        handler.result()
    return bool(handler.done() or handler.cancelled())


def _drop(handler: Callback | Task) -> bool:
    if isinstance(handler, Callback):
        handler.drop()
    return True
