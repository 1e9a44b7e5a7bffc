"""The executor that runs use: a `MultiThreadedExecutor` that submits each callback once."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future, wait
from threading import get_ident
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import (
    ConditionReachedException,
    ExternalShutdownException,
    MultiThreadedExecutor,
    ShutdownException,
    TimeoutException,
    TimeoutObject,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context


class QuickCallbackGroup(MutuallyExclusiveCallbackGroup):
    """Callbacks that a `QuickExecutor` runs at once, in the thread that spins.

    Such a callback must never block, sleep, wait for a future or for another callback, nor
    compute for long: until it returns, nothing else begins. In return it costs no hand-off to
    another thread. In any other executor the group is just mutually exclusive.
    """


class QuickExecutor(MultiThreadedExecutor):
    """A `MultiThreadedExecutor` that hands every callback to its pool exactly once.

    Callbacks in a `QuickCallbackGroup` run in the spinning thread, all others in the pool, with
    their groups' promises kept. Jazzy's own submits a callback again and again until it has
    begun (https://github.com/ros2/rclpy/issues/1452), while it holds the interpreter's lock.

    An exception in a callback, wherever it ran, ends the spin at once.
    """

    def __init__(self, num_threads: int | None = None, *, context: Context | None = None) -> None:
        super().__init__(num_threads, context=context)
        self._in_pool: dict[Any, bool] = {}  # True where it must run again: woken meanwhile
        self._pending: set[Future[None]] = set()
        self._workers: set[int] = set()
        self._failures: deque[BaseException] = deque()

    def _spin_once_impl(
        self,
        timeout_sec: float | TimeoutObject | None = None,
        wait_condition: Callable[[], bool] = lambda: False,
    ) -> None:
        try:
            task: Any
            entity: Any
            task, entity, _ = self.wait_for_ready_callbacks(timeout_sec, None, wait_condition)
        except (
            ExternalShutdownException,
            ShutdownException,
            TimeoutException,
            ConditionReachedException,
        ):
            pass
        else:
            if self._failures:
                pass
            elif entity is not None and isinstance(entity.callback_group, QuickCallbackGroup):
                task()
                if task.done():
                    task.result()
            else:
                self._submit(task)
        if self._failures:
            raise self._failures.popleft()

    def _submit(self, task: Any) -> None:
        with self._tasks_lock:
            submitted = task in self._in_pool
            self._in_pool[task] = submitted
        if not submitted:
            future = self._executor.submit(self._run_in_pool, task)
            self._pending.add(future)
            future.add_done_callback(self._pending.discard)

    def _run_in_pool(self, task: Any) -> None:
        self._workers.add(get_ident())
        try:
            again = True
            while again:
                task()
                with self._tasks_lock:
                    # A coroutine that waits is run again when the executor wakes; where it woke
                    # while the coroutine ran, what it waits for may have come meanwhile.
                    again = self._in_pool.pop(task) and not (task.done() or task.cancelled())
                    if again:
                        self._in_pool[task] = False
            if task.done():
                task.result()
        except BaseException as error:  # noqa: BLE001 - it is raised in the thread that spins
            self._failures.append(error)
            if not self._is_shutdown:
                self.create_task(_nothing)  # ends the wait
        finally:
            self._workers.discard(get_ident())

    def shutdown(self, timeout_sec: float | None = None, *, wait_for_threads: bool = True) -> bool:
        """Stop, wait for the callbacks in the pool to finish, and end its threads.

        Parameters
        ----------
        timeout_sec
            How long to wait for the callbacks [s]; None or negative: as long as it takes.
        wait_for_threads
            False to return while the pool's idle threads are still ending.

        Returns
        -------
        bool
            False where callbacks were still running after `timeout_sec`; call it again then.
            A callback that calls this isn't waited for.

        """
        self._is_shutdown = True
        self.wake()
        inside = get_ident() in self._workers
        if timeout_sec is not None and timeout_sec < 0:
            timeout_sec = None
        if not inside and wait(tuple(self._pending), timeout_sec).not_done:
            return False
        self._executor.shutdown(wait=wait_for_threads and not inside)
        return bool(super().shutdown(timeout_sec))


def _nothing() -> None:
    pass
