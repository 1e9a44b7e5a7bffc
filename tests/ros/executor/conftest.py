"""An executor in a context of the test's own, nodes in it, and two ways to spin it."""

# ruff: noqa: SLF001 - rclpy's private names are the point.

from __future__ import annotations

import threading
from functools import partial
from inspect import iscoroutine
from typing import TYPE_CHECKING

import pytest
from rclpy.node import Node
from rclpy.task import Future, Task

from barc_sim.ros.executor import QuickExecutor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rclpy.context import Context


@pytest.fixture
def executor(ros: Context) -> Iterator[QuickExecutor]:
    """Return an executor with four threads."""
    executor = QuickExecutor(4, context=ros)
    yield executor
    executor.shutdown()


@pytest.fixture
def make_node(ros: Context, executor: QuickExecutor) -> Iterator[Callable[..., Node]]:
    """Return a function that makes a node in the executor."""
    nodes = []

    def make(name: str = 'tested', **options: object) -> Node:
        options.setdefault('start_parameter_services', False)
        node = Node(name, context=ros, enable_rosout=False, **options)
        nodes.append(node)
        executor.add_node(node)
        return node

    yield make
    for node in nodes:
        node.destroy_node()


@pytest.fixture
def node(make_node: Callable[..., Node]) -> Node:
    """Return a node in the executor."""
    return make_node()


@pytest.fixture
def until(
    executor: QuickExecutor,
    spin_until: Callable[[QuickExecutor, Callable[[], object]], None],
) -> Callable[[Callable[[], object]], None]:
    """Return a function that spins the executor in this thread until a condition holds."""
    return partial(spin_until, executor)


@pytest.fixture
def spinning(executor: QuickExecutor) -> Iterator[threading.Thread]:
    """Spin in another thread for as long as the test takes; its failure is the test's."""
    failures: list[BaseException] = []

    def spin() -> None:
        try:
            executor.spin()
        except BaseException as error:  # noqa: BLE001 - the test's thread raises it
            failures.append(error)

    thread = threading.Thread(target=spin)
    thread.start()
    yield thread
    executor.shutdown()
    thread.join(20)
    assert not thread.is_alive()
    if failures:
        raise failures[0]


@pytest.fixture
def tasks_of_7_1_9(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have tasks resumed as from rclpy 7.1.9 on.

    There, a coroutine gives the future that it awaits to its task, which adds a done callback.
    """
    monkeypatch.setattr(Future, '__await__', _await_once)
    monkeypatch.setattr(Task, '__call__', _step)
    monkeypatch.setattr('barc_sim.ros.executor.rclpy_private.TASKS_RESUME_THEMSELVES', True)


@pytest.fixture(params=[False, True], ids=['installed', '7.1.9'])
def rclpys_tasks(request: pytest.FixtureRequest) -> None:
    """Have tasks resumed as in the rclpy that is installed, and as from rclpy 7.1.9 on."""
    if request.param:
        request.getfixturevalue('tasks_of_7_1_9')


def _await_once(future: Future) -> Iterator[Future]:
    if not (future.done() or future.cancelled()):
        yield future
    return future.result()


def _step(task: Task, function_step: Callable[[Task], None] = Task.__call__) -> None:
    if task.done() or task.cancelled() or task.executing():
        return
    if not iscoroutine(task._handler):
        function_step(task)
        return
    task._executing = True
    try:
        awaited = task._handler.send(None)
    except StopIteration as end:
        task.set_result(end.value)
    except Exception as error:  # noqa: BLE001 - as rclpy does
        task.set_exception(error)
    else:
        executor = task._executor()
        if awaited is None:
            executor._call_task_in_next_spin(task)
        else:
            awaited._set_executor(executor)
            awaited.add_done_callback(lambda _: task())
    task._executing = False
