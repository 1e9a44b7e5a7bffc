"""The threads that execute callbacks, and the tasks that they step."""

# ruff: noqa: SLF001 - `rclpy_private` checks rclpy's private names.

from __future__ import annotations

from collections import deque
from itertools import count
from threading import Condition, get_ident
from typing import TYPE_CHECKING, Any

from rclpy.task import Task

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine
    from concurrent.futures import ThreadPoolExecutor

    from rclpy.executors import MultiThreadedExecutor

    from barc_sim.ros.executor.entities import Entry


class ThreadPool:
    """Calls each function that is submitted once, and keeps what is raised.

    Parameters
    ----------
    threads
        Those that call.
    on_end
        Called in the thread whenever a function has returned or raised.
    """

    def __init__(self, threads: ThreadPoolExecutor, on_end: Callable[[], None]) -> None:
        self.failures: deque[BaseException] = deque()  #: for the spinning thread to raise
        self._threads = threads
        self._on_end = on_end
        self._inside: set[int] = set()  # threads that call a function
        self._unfinished = 0
        self._changed = Condition()
        self._closed = False

    def submit(self, function: Callable[[], object], drop: Callable[[], object]) -> None:
        """Call a function in a thread of the pool, or `drop` where the pool is closed by then."""
        with self._changed:
            if not self._closed:
                self._unfinished += 1
                self._threads.submit(self._run, function, drop)
                return
        drop()

    def _run(self, function: Callable[[], object], drop: Callable[[], object]) -> None:
        self._inside.add(get_ident())
        try:
            drop() if self._closed else function()
        except BaseException as error:  # noqa: BLE001 - the spinning thread raises it
            self.failures.append(error)
        finally:
            self._inside.discard(get_ident())
            with self._changed:
                self._unfinished -= 1
                self._changed.notify_all()
            self._on_end()

    def is_full(self, *, besides: int = 0) -> bool:
        """Whether another function would be one too many, with so many `besides` the pool's."""
        return self._unfinished + besides >= self._threads._max_workers

    def is_inside(self) -> bool:
        """Whether this thread calls a function of the pool."""
        return get_ident() in self._inside

    def close(self, timeout_sec: float) -> bool:
        """Begin no further function; return whether all end within a time (-1: no limit)."""
        with self._changed:
            self._closed = True
            return self._changed.wait_for(
                lambda: not self._unfinished, None if timeout_sec < 0 else timeout_sec
            )


class TaskStepper:
    """Steps what `create_task` has made and what awaits something, whenever it may go on."""

    def __init__(self, executor: MultiThreadedExecutor, wake: Callable[[], None]) -> None:
        self._executor = executor
        self._wake = wake
        self._stepped: set[Task] = set()  # by some thread
        self._changes = count(1)
        self._change = 0

    def note_change(self) -> None:
        """Note that something may have ended a coroutine's wait."""
        self._change = next(self._changes)

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
                and getattr(task, 'seen', None) != self._change
            ]

    def begin(self, task: Task) -> None:
        """Keep a task from being stepped by two threads."""
        self._stepped.add(task)

    def start(self, entry: Entry, coroutine: Coroutine[Any, Any, Any]) -> None:
        """Step a callback's coroutine, which gives the entry's group back at its end."""
        self.step(Task(_finish(entry, coroutine), executor=self._executor), entry)

    def step(self, task: Task, entry: Entry | None = None) -> None:
        """Run a task until it has to wait."""
        task.seen = self._change
        try:
            task()
        finally:
            self._stepped.discard(task)
        if task.done():
            self.note_change()
            task.result()  # raises
        elif entry:
            with self._executor._tasks_lock:
                self._executor._tasks.append((task, entry.entity, entry.node))
            self._wake()

    def drop(self, task: Task) -> None:
        """Step a task no further, as the executor was shut down."""
        self._stepped.discard(task)

    def cancel_coroutines(self) -> None:
        """End the coroutines of callbacks, so that their groups are given back."""
        for task, entity, _ in self._executor._tasks:
            if entity is not None:
                task.cancel()


async def _finish(entry: Entry, coroutine: Coroutine[Any, Any, Any]) -> None:
    try:
        await coroutine
    except Exception as error:  # noqa: BLE001 - warned of or raised
        entry.warn_or_raise(error)
    finally:
        entry.end()
