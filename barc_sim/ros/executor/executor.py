"""The executor that runs use: rclpy's `MultiThreadedExecutor`, right under load and fast.

Jazzy's own submits a callback to its pool again and again until it has begun
(https://github.com/ros2/rclpy/issues/1452), and builds a wait set for every callback. This one
submits once, keeps its wait set until the graph changes, and runs the callbacks of a
`QuickCallbackGroup` in the thread that spins.
"""

from __future__ import annotations

import sys
import time
import traceback
import warnings
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.executors import (
    ConditionReachedException,
    ExternalShutdownException,
    MultiThreadedExecutor,
    ShutdownException,
    TimeoutException,
    TimeoutObject,
)
from rclpy.task import Future, Task
from rclpy.utilities import timeout_sec_to_nsec

from barc_sim.ros.executor.rclpy_private import differing
from barc_sim.ros.executor.thread_pool import Callback, Pool
from barc_sim.ros.executor.wait_set import WaitList

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Generator, Iterator

    from rclpy.context import Context
    from rclpy.node import Node

    from barc_sim.ros.executor.wait_set import Entity, Entry

#: In debug mode, a quick callback that takes longer is warned of [s].
QUICK_LIMIT = 2e-3

_DIFFERING = differing()
if _DIFFERING:
    warnings.warn(
        f'this rclpy has no {", ".join(_DIFFERING)}: QuickExecutor waits as slowly as '
        'MultiThreadedExecutor; use rclpy 7.1 for a fast one',
        stacklevel=2,
    )


class QuickCallbackGroup(MutuallyExclusiveCallbackGroup):
    """Callbacks that a `QuickExecutor` runs at once, in the thread that spins.

    Such a callback must never block or sleep, wait for a future or for another callback, or
    compute for long: until it returns, nothing else begins. In return it costs no hand-off to
    another thread. For any other executor the group is an ordinary mutually exclusive one.
    """


class QuickExecutor(MultiThreadedExecutor):
    """A `MultiThreadedExecutor` that hands every callback to its pool exactly once.

    Callbacks in a `QuickCallbackGroup` run in the spinning thread, all others in the pool, with
    their groups' promises kept. An exception in a callback, wherever it ran, ends the spin at
    once. `debug` (by default in `python -X dev`) warns of quick callbacks that take longer than
    `QUICK_LIMIT`.
    """

    _tasks: list[tuple[Task, Entity | None, Node | None]]  # rclpy's

    def __init__(
        self,
        num_threads: int | None = None,
        *,
        context: Context | None = None,
        debug: bool = sys.flags.dev_mode,
    ) -> None:
        self._wait_list = WaitList()
        super().__init__(num_threads, context=context)
        self._debug = debug
        self._pool = Pool()

    def __del__(self) -> None:
        """Let go of the entities, where it is forgotten without a shutdown."""
        self._wait_list.invalidate()
        super().__del__()

    def trigger(self) -> None:
        """End the wait in progress."""
        guard = self._guard
        if guard is not None:
            with suppress(InvalidHandle):  # shut down meanwhile
                guard.trigger()

    def wake(self) -> None:
        """Look at the nodes again: something was created or destroyed."""
        self._wait_list.invalidate()
        self.trigger()

    def add_node(self, node: Node) -> bool:
        """Add a node; return False where it was there already."""
        added = super().add_node(node)
        self.wake()
        return bool(added)

    def remove_node(self, node: Node) -> None:
        """Stop executing the node's callbacks."""
        super().remove_node(node)
        self.wake()

    def spin_once_until_future_complete(
        self, future: Future, timeout_sec: float | TimeoutObject | None = None
    ) -> None:
        """Execute one callback, or return because the future is done or the time over."""

        def wake(_: Future) -> None:
            self.trigger()

        future.add_done_callback(wake)
        self._spin_once_impl(timeout_sec, future.done)
        future.remove_done_callback(wake)  # rclpy leaves one behind at every call

    def shutdown(self, timeout_sec: float | None = None, *, wait_for_threads: bool = True) -> bool:
        """Stop, wait for the callbacks that have begun, and end the pool's threads.

        Returns False where callbacks still ran after `timeout_sec` (None or negative: no end);
        call it again then. From within a callback it returns at once.
        """
        self._is_shutdown = True
        self.trigger()
        inside = self._pool.inside()
        if timeout_sec is not None and timeout_sec < 0:
            timeout_sec = None
        if self._pool.close(0 if inside else timeout_sec):
            for task, entity, _ in self._tasks:
                if entity is not None:
                    task.cancel()  # gives its group back
        elif not inside:
            return False
        while self._pool.failures:  # no spin is left to raise them
            traceback.print_exception(self._pool.failures.popleft())
        self._executor.shutdown(wait=wait_for_threads and not inside)
        self._wait_list.invalidate()
        # Not MultiThreadedExecutor's: a newer one waits for this thread, too.
        return bool(super(MultiThreadedExecutor, self).shutdown(timeout_sec))

    def _spin_once_impl(
        self,
        timeout_sec: float | TimeoutObject | None = None,
        wait_condition: Callable[[], bool] = lambda: False,
    ) -> None:
        try:
            ready: Any = self.wait_for_ready_callbacks(timeout_sec, None, wait_condition)
        except (
            ExternalShutdownException,
            ShutdownException,
            TimeoutException,
            ConditionReachedException,
        ):
            pass
        else:
            handler, entity, node = ready
            if entity is not None and isinstance(entity.callback_group, QuickCallbackGroup):
                self._run_quick(handler, entity, node)
            else:
                self._pool.submit(handler, self._executor, self.trigger)
        if self._pool.failures:
            raise self._pool.failures.popleft()

    def _run_quick(self, handler: Callback | Task, entity: Entity, node: Node) -> None:
        begun = time.perf_counter()
        self._pool.run_here(handler)
        took = time.perf_counter() - begun
        if self._debug and took > QUICK_LIMIT:
            name = getattr(entity, 'topic', type(entity).__name__)
            node.get_logger().warning(
                f'the quick callback of {name!r} took {took * 1e3:.1f} ms, more than '
                f'{QUICK_LIMIT * 1e3:g} ms: shorten it or put it into another callback group'
            )

    def _resume_later(self, coroutine: Coroutine[Any, Any, None], entry: Entry) -> None:
        with self._tasks_lock:
            self._tasks.append((Task(coroutine, executor=self), entry.entity, entry.node))
        self.trigger()

    def _wait_for_ready_callbacks(
        self,
        timeout_sec: float | TimeoutObject | None = None,
        nodes: list[Node] | None = None,
        condition: Callable[[], bool] = lambda: False,
    ) -> Generator[Any, None, None]:
        def ended() -> bool:
            self._pool.wake()
            return bool(self._pool.failures) or condition()

        if nodes is not None or _DIFFERING:
            yield from super()._wait_for_ready_callbacks(timeout_sec, nodes, ended)
            return
        seconds = timeout_sec.timeout if isinstance(timeout_sec, TimeoutObject) else timeout_sec
        left = timeout = timeout_sec_to_nsec(seconds)
        deadline = None
        yielded = False
        while not (yielded or self._is_shutdown or ended()):
            for ready in self._waiting_tasks():
                yielded = True
                yield ready
            if timeout > 0:
                deadline = deadline or time.monotonic_ns() + timeout
                left = max(0, deadline - time.monotonic_ns())
            for ready in self._ready_callbacks(left):
                yielded = True
                yield ready
            if left == 0 and not yielded:
                raise TimeoutException
        if self._is_shutdown:
            raise ShutdownException
        if ended():
            raise ConditionReachedException

    def _ready_callbacks(self, timeout_nsec: int) -> Iterator[tuple[Callback, Entity, Node]]:
        for entry in self._wait_list.wait(self, timeout_nsec):
            execute = None if self._is_shutdown else self._wait_list.take(self, entry)
            if execute is not None:
                callback = Callback(entry, execute, self.trigger, self._resume_later)
                yield callback, entry.entity, entry.node

    def _waiting_tasks(self) -> list[tuple[Any, Any, Any]]:
        """Tasks to begin and coroutines that wait, the newest first, as in rclpy."""
        if not self._tasks:
            return []
        nodes = (None, *self.get_nodes())
        with self._tasks_lock:
            self._tasks = [
                each for each in self._tasks if not (each[0].done() or each[0].cancelled())
            ]
            return [
                each
                for each in reversed(self._tasks)
                if each[0] not in self._pool and each[2] in nodes
            ]
