"""Coroutines, tasks, futures and actions go rclpy's way."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

import pytest
from rcl_interfaces.srv import ListParameters
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.task import Future

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rclpy.callback_groups import CallbackGroup
    from rclpy.node import Node

    from barc_sim.ros.executor import QuickExecutor

    Until = Callable[[Callable[[], object]], None]

pytestmark = pytest.mark.timeout(60)
GROUPS = pytest.mark.parametrize(
    'group_type', [ReentrantCallbackGroup, MutuallyExclusiveCallbackGroup]
)


@GROUPS
def test_a_callback_waits_for_a_future_of_another_callback(
    node: Node, executor: QuickExecutor, until: Until, group_type: type[CallbackGroup]
) -> None:
    future = Future(executor=executor)
    results = []

    async def wait() -> None:
        waiter.cancel()
        results.append(await future)

    def fulfil() -> None:
        other.cancel()
        future.set_result('done')

    waiter = node.create_timer(0.001, wait, callback_group=group_type())
    other = node.create_timer(0.01, fulfil, callback_group=group_type())

    until(lambda: results)

    assert results == ['done']


def test_a_waiting_coroutine_keeps_its_exclusive_group(
    node: Node, executor: QuickExecutor, until: Until
) -> None:
    group = MutuallyExclusiveCallbackGroup()
    future = Future(executor=executor)
    order = []

    async def wait() -> None:
        order.append('begin')
        await future
        order.append('end')

    guard = node.create_guard_condition(wait, callback_group=group)
    guard.trigger()
    until(lambda: order)
    other = node.create_guard_condition(lambda: order.append('other'), callback_group=group)
    other.trigger()
    ticks = []
    timer = node.create_timer(
        0.001, lambda: ticks.append(1), callback_group=MutuallyExclusiveCallbackGroup()
    )
    until(lambda: len(ticks) > 5)
    timer.cancel()
    assert order == ['begin']

    future.set_result(None)
    executor.wake()
    until(lambda: len(order) == 3)
    assert order == ['begin', 'end', 'other']


@GROUPS
def test_a_coroutine_calls_a_service(
    node: Node, until: Until, group_type: type[CallbackGroup]
) -> None:
    def serve(
        request: ListParameters.Request, response: ListParameters.Response
    ) -> ListParameters.Response:
        response.result.names = request.prefixes
        return response

    node.create_service(ListParameters, 'serve', serve, callback_group=group_type())
    client = node.create_client(ListParameters, 'serve', callback_group=group_type())
    names = []

    async def ask() -> None:
        timer.cancel()
        answer = await client.call_async(ListParameters.Request(prefixes=['a']))
        names.extend(answer.result.names)

    timer = node.create_timer(0.001, ask, callback_group=group_type())
    client.wait_for_service(20.0)

    until(lambda: names == ['a'])


def test_tasks_run_and_wait_for_one_another(executor: QuickExecutor, until: Until) -> None:
    async def double(future: Future) -> int:
        return 2 * await future

    first = executor.create_task(lambda: 1)
    second = executor.create_task(double, first)
    third = executor.create_task(double, second)

    until(third.done)

    assert third.result() == 4


def test_what_comes_while_a_coroutine_is_stepped_is_not_missed(
    node: Node, executor: QuickExecutor
) -> None:
    stepping = threading.Event()
    come = threading.Event()
    noticed = threading.Event()

    class Late:
        def __await__(self) -> Iterator[None]:
            while not come.is_set():
                stepping.set()
                noticed.wait(20.0)
                time.sleep(0.05)  # the executor waits again by now
                yield

    async def wait() -> str:
        await Late()
        return 'come'

    guard = node.create_guard_condition(
        noticed.set, callback_group=MutuallyExclusiveCallbackGroup()
    )

    def come_late() -> None:
        stepping.wait(20.0)
        come.set()
        guard.trigger()

    thread = threading.Thread(target=come_late)
    thread.start()
    task = executor.create_task(wait)
    executor.spin_until_future_complete(task, 20.0)
    thread.join()

    assert task.result() == 'come'


def test_a_waiting_coroutine_is_left_alone_while_nothing_happens(executor: QuickExecutor) -> None:
    steps = []

    class Waiting:
        def __await__(self) -> Iterator[None]:
            while True:
                steps.append(1)
                yield

    async def wait() -> None:
        await Waiting()

    executor.create_task(wait)
    executor.create_task(wait)
    executor.spin_until_future_complete(Future(), 0.2)

    assert 2 <= len(steps) <= 20


def test_a_cancelled_task_is_dropped(executor: QuickExecutor, until: Until) -> None:
    async def wait() -> None:
        await Future(executor=executor)

    task = executor.create_task(wait)
    executor.spin_once(timeout_sec=0.01)
    until(lambda: not task.executing())
    task.cancel()
    done = executor.create_task(lambda: 1)
    until(done.done)
    assert task.cancelled()


def test_a_plain_task_that_takes_long_runs_once(executor: QuickExecutor, until: Until) -> None:
    release = threading.Event()
    begun = []

    def run() -> None:
        begun.append(1)
        release.wait(20)

    task = executor.create_task(run)
    for _ in range(20):
        executor.spin_once(timeout_sec=0.001)
    release.set()
    until(task.done)
    assert begun == [1]


def test_an_action_is_served_with_feedback_and_can_be_cancelled(
    make_node: Callable[..., Node], until: Until
) -> None:
    fibonacci = pytest.importorskip('test_msgs.action').Fibonacci
    action = pytest.importorskip('rclpy.action')
    going_on = threading.Event()

    def execute(goal: action.server.ServerGoalHandle) -> object:
        goal.publish_feedback(fibonacci.Feedback(sequence=[0, 1]))
        if goal.request.order < 0:
            while not goal.is_cancel_requested:
                going_on.wait(0.001)
            goal.canceled()
        else:
            goal.succeed()
        return fibonacci.Result(sequence=[goal.request.order])

    server = action.ActionServer(
        make_node('server'),
        fibonacci,
        'fibonacci',
        execute,
        cancel_callback=lambda _: action.CancelResponse.ACCEPT,
    )
    client = action.ActionClient(make_node('client'), fibonacci, 'fibonacci')
    feedback = []
    assert client.wait_for_server(20.0)

    def send(order: int) -> object:
        future = client.send_goal_async(
            fibonacci.Goal(order=order), lambda message: feedback.append(message.feedback)
        )
        until(future.done)
        assert future.result().accepted
        return future.result()

    result = send(3).get_result_async()
    until(lambda: result.done() and feedback)
    assert list(result.result().result.sequence) == [3]

    endless = send(-1)
    until(lambda: len(feedback) == 2)
    cancelled = endless.cancel_goal_async()
    result = endless.get_result_async()
    until(lambda: cancelled.done() and result.done())
    assert list(result.result().result.sequence) == [-1]
    client.destroy()
    server.destroy()
