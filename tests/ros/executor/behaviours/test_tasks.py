"""Tasks, coroutines and futures."""

from __future__ import annotations

import asyncio
import threading
from typing import TYPE_CHECKING

import pytest
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.task import Future
from std_msgs.msg import Int32
from std_srvs.srv import Trigger

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.executors import Executor
    from rclpy.node import Node

    Until = Callable[[Callable[[], object]], None]

pytestmark = pytest.mark.timeout(60)
DEADLINE = 20.0


@pytest.fixture(params=['Single', 'Multi', 'Quick', 'Quick-7.1.9'])
def kind(request: pytest.FixtureRequest) -> str:
    """Return the name of each executor; ours also runs with the tasks of rclpy 7.1.9."""
    name, _, version = str(request.param).partition('-')
    if version:
        request.getfixturevalue('tasks_of_7_1_9')
    return name


def test_a_function_and_a_coroutine_return_results(executor: Executor, until: Until) -> None:
    async def add(a: int, b: int) -> int:
        return a + b

    tasks = [executor.create_task(lambda a, b: a * b, 2, b=3), executor.create_task(add, 2, b=3)]
    until(lambda: all(task.done() for task in tasks))
    assert [task.result() for task in tasks] == [6, 5]


def test_a_task_of_another_thread_ends_a_wait(executor: Executor, node: Node) -> None:
    del node
    tasks = []
    done = Future(executor=executor)

    def finish() -> None:
        done.set_result(1)

    timer = threading.Timer(0.02, lambda: tasks.append(executor.create_task(finish)))
    timer.start()
    executor.spin_until_future_complete(done, DEADLINE)
    timer.join()
    assert done.done()


@pytest.mark.parametrize('is_coroutine', [False, True], ids=['function', 'coroutine'])
def test_an_exception_of_a_task_is_raised_and_kept(
    executor: Executor, until: Until, *, is_coroutine: bool
) -> None:
    def fail() -> None:
        raise ZeroDivisionError('of the task')

    async def fail_later() -> None:
        fail()

    task = executor.create_task(fail_later if is_coroutine else fail)
    with pytest.raises(ZeroDivisionError, match='of the task'):
        until(lambda: False)
    assert task.done()
    assert isinstance(task.exception(), ZeroDivisionError)


def test_coroutines_await_one_another(executor: Executor, until: Until) -> None:
    async def double(future: Future) -> int:
        return 2 * await future

    first = executor.create_task(lambda: 1)
    second = executor.create_task(double, first)
    third = executor.create_task(double, second)
    until(third.done)
    assert third.result() == 4


ENDS = pytest.mark.parametrize(
    ('end', 'result'),
    [
        (lambda future: future.set_result('done'), 'done'),
        (lambda future: future.set_exception(ZeroDivisionError()), 'failed'),
        (lambda future: future.cancel(), None),
    ],
    ids=['result', 'exception', 'cancel'],
)


async def outcome(future: Future) -> object:
    """Await a future; its exception is a result."""
    try:
        return await future
    except ZeroDivisionError:
        return 'failed'


@ENDS
@pytest.mark.parametrize('is_owned', [True, False], ids=['of the executor', 'of nobody'])
def test_a_coroutine_continues_when_its_future_is_done_between_spins(
    executor: Executor,
    end: Callable[[Future], object],
    result: object,
    *,
    is_owned: bool,
) -> None:
    future = Future(executor=executor if is_owned else None)
    task = executor.create_task(outcome, future)
    executor.spin_once(timeout_sec=0.02)
    end(future)
    executor.spin_until_future_complete(task, DEADLINE)
    assert task.done()
    assert task.result() == result


def test_a_coroutine_continues_when_a_thread_completes_its_future(
    executor: Executor, deadline: float
) -> None:
    future = Future()
    task = executor.create_task(outcome, future)
    timer = threading.Timer(0.02, lambda: future.set_result('done'))
    timer.start()
    executor.spin_until_future_complete(task, deadline)
    timer.join()
    assert task.done()


def test_a_coroutine_continues_with_a_loop_of_spin_once(executor: Executor, until: Until) -> None:
    """As beside a GUI, which spins now and then."""
    future = Future(executor=executor)

    async def wait() -> object:
        return await future

    async def wait_for_both() -> list[object]:
        return [await wait(), await wait()]

    task = executor.create_task(wait_for_both)
    for _ in range(3):
        executor.spin_once(timeout_sec=0)
    future.set_result(1)
    until(task.done)
    assert task.result() == [1, 1]


def test_a_coroutine_that_only_yields_continues(executor: Executor, deadline: float) -> None:
    async def yield_thrice() -> str:
        for _ in range(3):
            await asyncio.sleep(0)
        return 'done'

    task = executor.create_task(yield_thrice)
    executor.spin_until_future_complete(task, deadline)
    assert task.result() == 'done'


def test_a_cancelled_coroutine_is_closed_and_dropped(executor: Executor, until: Until) -> None:
    closed = []

    async def wait() -> None:
        try:
            await Future(executor=executor)
        finally:
            closed.append(1)

    task = executor.create_task(wait)
    executor.spin_once(timeout_sec=0.02)
    until(lambda: not task.executing())
    task.cancel()
    other = executor.create_task(lambda: 1)
    until(other.done)
    assert task.cancelled()
    assert closed == [1]


def test_done_callbacks_are_called_with_their_future(executor: Executor, until: Until) -> None:
    called = []
    before = Future(executor=executor)
    before.add_done_callback(called.append)
    before.set_result(1)
    after = Future(executor=executor)
    after.set_result(2)
    after.add_done_callback(called.append)
    cancelled = Future(executor=executor)
    cancelled.add_done_callback(called.append)
    cancelled.cancel()
    removed = Future(executor=executor)
    removed.add_done_callback(called.append)
    assert removed.remove_done_callback(called.append)

    removed.set_result(3)
    until(lambda: len(called) == 3)
    assert set(called) == {before, after, cancelled}


def test_done_callbacks_run_before_later_messages(
    executor: Executor, node: Node, until: Until
) -> None:
    """Three of them, so that a `spin_once` is not enough for all."""
    order: list[object] = []
    publisher = node.create_publisher(Int32, 'number', 10)
    node.create_subscription(Int32, 'number', lambda message: order.append(message.data), 10)
    until(publisher.get_subscription_count)
    future = Future(executor=executor)
    for _ in range(3):
        future.add_done_callback(lambda _: order.append('done'))
    node.create_guard_condition(lambda: future.set_result(1)).trigger()
    executor.spin_until_future_complete(future, DEADLINE)
    publisher.publish(Int32(data=1))
    until(lambda: len(order) == 4)

    assert order == ['done', 'done', 'done', 1]


def test_tasks_that_make_new_ones_starve_no_message(
    executor: Executor, node: Node, until: Until
) -> None:
    received: list[int] = []
    publisher = node.create_publisher(Int32, 'number', 10)
    node.create_subscription(Int32, 'number', lambda message: received.append(message.data), 10)

    def go_on() -> None:
        if len(received) < 3:
            executor.create_task(go_on)

    until(publisher.get_subscription_count)
    go_on()
    for number in range(3):
        publisher.publish(Int32(data=number))
    until(lambda: len(received) == 3)
    assert received == [0, 1, 2]


@pytest.mark.parametrize('source', ['timer', 'guard', 'subscription', 'service'])
def test_a_callback_can_be_a_coroutine(
    executor: Executor, node: Node, until: Until, source: str
) -> None:
    future = Future(executor=executor)
    order: list[object] = []
    group = ReentrantCallbackGroup()

    async def work(*arguments: object) -> object:
        timer.cancel()
        order.append('begun')
        order.append(await future)
        return arguments[-1] if arguments else None

    timer = node.create_timer(0.001 if source == 'timer' else 3600.0, work, callback_group=group)
    guard = node.create_guard_condition(work, callback_group=group)
    node.create_subscription(Int32, 'number', work, 10, callback_group=group)
    node.create_service(Trigger, 'trigger', work, callback_group=group)
    publisher = node.create_publisher(Int32, 'number', 10)
    client = node.create_client(Trigger, 'trigger')
    until(lambda: client.service_is_ready() and publisher.get_subscription_count())
    answer = None
    if source == 'guard':
        guard.trigger()
    elif source == 'subscription':
        publisher.publish(Int32())
    elif source == 'service':
        answer = client.call_async(Trigger.Request())
    until(lambda: order)
    assert order == ['begun']

    future.set_result('ended')
    until(lambda: len(order) == 2 and (answer is None or answer.done()))
    assert order == ['begun', 'ended']


def test_a_waiting_coroutine_keeps_its_exclusive_group(
    executor: Executor, node: Node, until: Until
) -> None:
    group = MutuallyExclusiveCallbackGroup()
    future = Future(executor=executor)
    order = []

    async def wait() -> None:
        order.append('begin')
        await future
        order.append('end')

    node.create_guard_condition(wait, callback_group=group).trigger()
    until(lambda: order)
    other = node.create_guard_condition(lambda: order.append('other'), callback_group=group)
    other.trigger()
    ticks: list[int] = []
    node.create_timer(0.001, lambda: ticks.append(1), callback_group=ReentrantCallbackGroup())
    until(lambda: len(ticks) > 3)
    assert order == ['begin']

    future.set_result(None)
    until(lambda: len(order) == 3)
    assert order == ['begin', 'end', 'other']
