"""The tasks of an executor: which of them is stepped next, and what the others wait for."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import barc_sim.ros.executor.rclpy_private as private

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from rclpy.node import Node
    from rclpy.task import Future, Task

    from barc_sim.ros.executor.entities import Entry
    from barc_sim.ros.executor.events import Events


@dataclass(frozen=True)
class WhenDone:
    """A future's done callback that any thread may call.

    An executor need not schedule it as a task: it only notes that the future is done.
    """

    note: Callable[[Any], None]

    def __call__(self, future: Future) -> None:
        """Note that the future is done."""
        self.note(future)


class Tasks:
    """The tasks of an executor that are not done.

    Tasks are stepped in rounds. A round takes the tasks that are ready when it begins; tasks that
    become ready later are of the next round. A poll for arrivals lies between two rounds, and a
    round continues where the last `spin_once` has ended it. So tasks and entities take turns, and a
    future's done callback begins before a message that arrives after the future was done.

    =========  =====================================  ===========================================
    state      event                                  next state
    =========  =====================================  ===========================================
    new        `create_task`                          ready
    new        a callback's coroutine has to wait     as after a step
    ready      a round begins                         in the round, if its node is in the executor
    ready      a round begins                         suspended, if its node is not
    suspended  nodes are added or removed             ready
    in round   its turn                               stepped, by the thread that leads
    stepped    awaits a future that is not done       waiting
    stepped    yields without a future                ready
    waiting    the future is done or cancelled        ready
    all        returns, raises or is cancelled        forgotten; an exception ends the spins
    =========  =====================================  ===========================================

    From rclpy 7.1.9 on, a task steps itself when the future that it awaits is done: it is not
    waiting here, and rclpy makes it ready when it yields without a future.
    """

    def __init__(self, events: Events) -> None:
        self.ready: dict[Task, None] = {}  #: tasks of the next round, oldest first
        self.polled = True  #: whether a poll has followed the last round: the next one may begin
        self._entries: dict[Task, Entry | None] = {}  # all tasks; entry: of a callback's coroutine
        self._round: deque[Task] = deque()
        self._waiting: dict[Task, Future] = {}
        self._suspended: dict[Task, None] = {}
        self._events = events
        self._on_future_done = WhenDone(events.wake)
        self._on_task_done = WhenDone(self._forget)

    def __bool__(self) -> bool:
        """Return whether a task is not done."""
        return bool(self._entries)

    def add(self, task: Task, entry: Entry | None = None, *, stepped: bool = False) -> None:
        """Add a task, or make it ready again; any thread may call this.

        `entry` is that of a callback whose coroutine the task is. A task that is `stepped` already
        is ready when it need not wait.
        """
        if task not in self._entries:
            self._entries[task] = entry
            task.add_done_callback(self._on_task_done)
        if stepped:
            self.after_step(task)
        else:
            self._make_ready(task)

    def after_step(self, task: Task) -> None:
        """Let a task wait for the future that it awaits."""
        if private.TASKS_RESUME_THEMSELVES or task not in self._entries:
            return
        future = private.awaited_future(task)
        if future:
            self._waiting[task] = future
            future.add_done_callback(self._on_future_done)
        else:
            self._make_ready(task)

    def next_of_round(self, nodes: Collection[Node]) -> Task | None:
        """Return the task to step next; None: the round is over."""
        if self.polled:
            self.polled = False
            self._begin_round(nodes)
        while self._round:
            task = self._round.popleft()
            if task in self._entries and not task.executing():
                return task
        return None

    def resume_suspended(self) -> None:
        """Make the tasks ready whose nodes may be in the executor now."""
        self.ready.update(self._suspended)
        self._suspended.clear()

    def cancel_coroutines(self) -> None:
        """Cancel the coroutines of callbacks, which releases their groups."""
        for task, entry in list(self._entries.items()):
            if entry:
                task.cancel()

    def move_out(self) -> list[tuple[Task, Any, Node | None]]:
        """Give all tasks to rclpy's own methods, with their entities and nodes, oldest first."""
        moved: list[tuple[Task, Any, Node | None]] = []
        for task, entry in list(self._entries.items()):
            self._drop(task)
            task.remove_done_callback(self._on_task_done)
            if entry:
                moved.append((task, entry.entity, entry.node))
            else:
                moved.append((task, None, None))
        return moved

    def _begin_round(self, nodes: Collection[Node]) -> None:
        for task, future in list(self._waiting.items()):
            if future.done() or future.cancelled():
                self._waiting.pop(task, None)
                self.ready[task] = None

        tasks = list(self.ready)
        if not private.TASKS_RESUME_THEMSELVES:
            tasks.reverse()  # the order of this rclpy
        for task in tasks:
            self.ready.pop(task, None)
            entry = self._entries.get(task)
            if entry is None or entry.node in nodes:
                self._round.append(task)
            else:
                self._suspended[task] = None

    def _make_ready(self, task: Task) -> None:
        self.ready[task] = None
        self._events.wake()

    def _forget(self, task: Task) -> None:
        self._drop(task)
        error = task.exception()
        if error:
            self._events.fail(error)

    def _drop(self, task: Task) -> None:
        for tasks in (self._entries, self.ready, self._waiting, self._suspended):
            tasks.pop(task, None)
