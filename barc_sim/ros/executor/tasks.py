"""The tasks that an executor steps: what `create_task` has made, and callbacks that await."""

# ruff: noqa: SLF001 - `rclpy_private` checks rclpy's private names.

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy.task import Task

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rclpy.executors import MultiThreadedExecutor

    from barc_sim.ros.executor.entities import Entry


class TaskStepper:
    """Steps each task of an executor whenever it may go on."""

    def __init__(self, executor: MultiThreadedExecutor, wake: Callable[[], None]) -> None:
        self._executor = executor
        self._wake = wake
        self._stepped: set[Task] = set()  # by some thread
        #: Another object whenever something may have ended a coroutine's wait.
        self.change: object = object()

    def due(self) -> list[Task]:
        """Return the tasks that are new or may go on, the newest first, as in rclpy."""
        executor = self._executor
        if not executor._tasks:
            return []
        nodes = (None, *executor.get_nodes())
        with executor._tasks_lock:
            executor._tasks = [
                each for each in executor._tasks if not (each[0].done() or each[0].cancelled())
            ]
            return [
                task
                for task, _, node in reversed(executor._tasks)
                if task not in self._stepped
                and node in nodes
                and getattr(task, 'seen', None) is not self.change
            ]

    def start(self, entry: Entry, coroutine: Coroutine[Any, Any, Any]) -> None:
        """Step a callback's coroutine, which gives the entry's group back at its end."""
        self.step(Task(_finish(entry, coroutine), executor=self._executor), entry)

    def step(self, task: Task, entry: Entry | None = None) -> None:
        """Run a task until it has to wait."""
        self._stepped.add(task)
        task.seen = self.change
        try:
            task()
        finally:
            self._stepped.discard(task)
        if task.done():
            self.change = object()
            task.result()  # raises
        elif entry:
            with self._executor._tasks_lock:
                self._executor._tasks.append((task, entry.entity, entry.node))
            self._wake()

    def cancel_coroutines(self) -> None:
        """End the coroutines of callbacks, so that their groups are given back."""
        for task, entity, _ in self._executor._tasks:
            if entity is not None:
                task.cancel()


async def _finish(entry: Entry, coroutine: Coroutine[Any, Any, Any]) -> None:
    try:
        await coroutine
    except Exception as error:
        if not entry.warns_of(error):
            raise
    finally:
        entry.end()
