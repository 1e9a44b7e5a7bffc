"""Futures, tasks and executors, in one thread.

An arrival puts its receiver into the queue of the executor that has the receiver's node; the
executor calls back in the order of arrival.
"""

from __future__ import annotations

import heapq
import inspect
import threading
import time
import warnings
from collections import deque
from contextlib import suppress
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, Any

from barc_sim.ros.local.clocks import SECOND
from barc_sim.ros.local.context import get_default_context

if TYPE_CHECKING:
    from collections.abc import Callable, Generator

    from barc_sim.ros.local.clocks import Timer, World


class ExternalShutdownException(Exception):
    """The context has been shut down while an executor waited."""

    def __init__(self) -> None:
        super().__init__('The context has been shut down')


class Future:
    def __init__(self, *, executor: Executor | None = None) -> None:
        self._done = self._cancelled = False
        self._result: Any = None
        self._exception: BaseException | None = None
        self._callbacks: list[Callable[[Future], object]] = []
        self.executor = executor

    def __await__(self) -> Generator[Any, None, Any]:
        while not (self._done or self._cancelled):
            yield self
        return self.result()

    def done(self) -> bool:
        return self._done

    def cancelled(self) -> bool:
        return self._cancelled

    def result(self) -> Any:
        if self._exception:
            raise self._exception
        return self._result

    def exception(self) -> BaseException | None:
        return self._exception

    def set_result(self, result: Any) -> None:
        self._result, self._done = result, True
        self._call_back()

    def set_exception(self, exception: BaseException) -> None:
        self._exception, self._done = exception, True
        self._call_back()

    def cancel(self) -> None:
        if not self._done:
            self._cancelled = True
            self._call_back()

    def _call_back(self) -> None:
        while self._callbacks:
            callback = self._callbacks.pop(0)
            try:
                self._notify(callback)
            except Exception as error:  # noqa: BLE001 (as rclpy does: there may be more callbacks)
                warnings.warn(f'Unhandled exception in done callback: {error}', stacklevel=2)

    def _notify(self, callback: Callable[[Future], object]) -> None:
        if self.executor:
            self.executor.create_task(callback, self)
        else:
            callback(self)

    def add_done_callback(self, callback: Callable[[Future], object]) -> None:
        if self._done or self._cancelled:
            self._notify(callback)
        else:
            self._callbacks.append(callback)

    def remove_done_callback(self, callback: Callable[[Future], object]) -> bool:
        found = callback in self._callbacks
        if found:
            self._callbacks.remove(callback)
        return found


class Task(Future):
    """A function or coroutine that an executor runs; one that awaits continues when it can."""

    node: Any = None

    def __init__(self, handler: Any, args: Any, kwargs: Any, executor: Executor) -> None:
        super().__init__(executor=executor)
        self._handler = (
            handler if inspect.iscoroutine(handler) else partial(handler, *args, **kwargs)
        )

    def run(self) -> None:
        if self._done or self._cancelled:
            return
        assert self.executor  # noqa: S101 (a task has one)
        try:
            if not inspect.iscoroutine(self._handler):
                self._handler = self._handler()
            if not inspect.iscoroutine(self._handler):
                self.set_result(self._handler)
                return
            awaited = self._handler.send(None)
        except StopIteration as stop:
            self.set_result(stop.value)
        except Exception as error:
            self.set_exception(error)
            raise
        else:
            if isinstance(awaited, Future):
                awaited.add_done_callback(self._resume)
            else:
                self.executor.push(self)

    def _resume(self, _: Future) -> None:
        if self.executor:
            self.executor.push(self)

    def cancel(self) -> None:
        if inspect.iscoroutine(self._handler):
            self._handler.close()
        super().cancel()


class Executor:
    """Calls back in one thread, in the order of arrival."""

    def __init__(self, num_threads: int | None = None, *, context: Any = None) -> None:
        del num_threads
        self.context = context or get_default_context()
        self.world: World = self.context.world
        self._nodes: list[Any] = []
        self._ready: deque[Any] = deque()
        self._agenda: list[tuple[int, int, Timer]] = []
        self._numbers = count()
        self._is_shutdown = self.waits = False
        self._asleep = threading.Lock()
        self.thread = 0  # that spins
        self.context.on_shutdown(self.wake)

    def __enter__(self) -> Executor:  # noqa: PYI034 (Self is newer than Python 3.10)
        return self

    def __exit__(self, *_: object) -> None:
        self.shutdown()

    def add_node(self, node: Any) -> bool:
        if node in self._nodes:
            return False
        if node.executor is not None:
            node.executor.remove_node(node)
        self._nodes.append(node)
        node.take_executor(self)
        self.wake()
        return True

    def remove_node(self, node: Any) -> None:
        if node in self._nodes:
            self._nodes.remove(node)
            self._ready = deque(each for each in self._ready if each.node is not node)
            node.take_executor(None)

    def get_nodes(self) -> list[Any]:
        return [*self._nodes]

    def create_task(self, callback: Any, *args: Any, **kwargs: Any) -> Task:
        task = Task(callback, args, kwargs, self)
        self.push(task)
        return task

    def push(self, receiver: Any) -> None:
        """Call `receiver` once it is its turn; from any thread."""
        self._ready.append(receiver)
        if self.waits:
            self.wake()

    def at(self, due: int, timer: Timer) -> None:
        """Call `timer` at `due` [ns]."""
        heapq.heappush(self._agenda, (due, next(self._numbers), timer))

    def wake(self) -> None:
        with suppress(RuntimeError):  # awake already
            self._asleep.release()

    def next_due(self) -> int | None:
        """Return when there is something to call, in simulated time [ns]."""
        if self._ready:
            return self.world.now_ns
        agenda = self._agenda
        while agenda and not (
            agenda[0][2].due == agenda[0][0] and agenda[0][2].node.executor is self
        ):
            heapq.heappop(agenda)
        return agenda[0][0] if agenda else None

    def turn(self, until: int | None) -> bool:
        """Call back once; where nothing is ready, wait for it, but not beyond `until` [ns]."""
        agenda = self._agenda
        while agenda and agenda[0][0] <= self.world.now():
            due, _, timer = heapq.heappop(agenda)
            if timer.due == due and timer.node.executor is self:
                self._ready.append(timer)
        if self._ready:
            receiver = self._ready.popleft()
            result = receiver.run()
            if result is not None and inspect.iscoroutine(result):
                Task(result, (), {}, self).run()
            return True
        self.waits = True
        try:
            soonest = self.next_due()
            self._wait(min((t for t in (soonest, until) if t is not None), default=None))
        finally:
            self.waits = False
        if not self.context.is_ok and not self._is_shutdown:
            raise ExternalShutdownException
        return False

    def _wait(self, until: int | None) -> None:
        if self.world.simulated:
            self.world.pass_time(until)
        elif not self._ready:
            left = -1 if until is None else max(until - time.monotonic_ns(), 0) / SECOND
            self._asleep.acquire(timeout=left)

    def spin(self) -> None:
        while self.context.is_ok and not self._is_shutdown:
            self._spin(None, None)

    def spin_until_future_complete(self, future: Future, timeout_sec: float | None = None) -> None:
        future.add_done_callback(lambda _: self.wake())
        self._spin(future, self._until(timeout_sec))

    def _until(self, timeout_sec: float | None) -> int | None:
        if timeout_sec is None or timeout_sec < 0:
            return None
        return self.world.now() + int(timeout_sec * SECOND)

    def _spin(self, future: Future | None, until: int | None) -> None:
        context, turn = self.context, self.turn
        before, self.thread = self.thread, threading.get_ident()
        try:
            while context.is_ok and not self._is_shutdown:
                if future is not None and (future.done() or future.cancelled()):
                    return
                turn(until)
                if until is not None and self.world.now() >= until:
                    return
        finally:
            self.thread = before

    def spin_once(self, timeout_sec: float | None = None) -> None:
        until = self._until(timeout_sec)
        while self.context.is_ok and not self._is_shutdown and not self.turn(until):
            if until is not None and self.world.now() >= until:
                return

    def spin_once_until_future_complete(
        self, future: Future, timeout_sec: float | None = None
    ) -> None:
        future.add_done_callback(lambda _: self.wake())
        if not (future.done() or future.cancelled()):
            self.spin_once(timeout_sec)

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        del timeout_sec
        self._is_shutdown = True
        for node in self.get_nodes():
            self.remove_node(node)
        self.wake()
        return True


class SingleThreadedExecutor(Executor):
    def __init__(self, *, context: Any = None) -> None:
        super().__init__(context=context)


class MultiThreadedExecutor(Executor):
    """The name: on one thread, too."""


class CallbackGroup:
    """Names only: one thread calls back, so that nothing runs at the same time."""

    def __init__(self) -> None:
        self.entities: set[Any] = set()


class MutuallyExclusiveCallbackGroup(CallbackGroup):
    pass


class ReentrantCallbackGroup(CallbackGroup):
    pass
