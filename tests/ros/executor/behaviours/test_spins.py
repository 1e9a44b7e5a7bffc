"""Spins: what they execute, when they end, and what they raise."""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING

import pytest
from rclpy.context import Context
from rclpy.executors import (
    ConditionReachedException,
    ExternalShutdownException,
    ShutdownException,
    SingleThreadedExecutor,
    TimeoutException,
)
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Int32

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.executors import Executor

    Until = Callable[[Callable[[], object]], None]

pytestmark = pytest.mark.timeout(60)
DEADLINE = 20.0


def in_thread(function: Callable[[], object]) -> threading.Thread:
    """Start a function in another thread."""
    thread = threading.Thread(target=function, daemon=True)
    thread.start()
    return thread


def test_spin_once_without_a_ready_callback_returns(executor: Executor, node: Node) -> None:
    called = []
    node.create_timer(3600.0, lambda: called.append(1))
    executor.spin_once(timeout_sec=0)
    executor.spin_once(timeout_sec=0.001)
    assert called == []


def test_spin_once_executes_one_callback(executor: Executor, node: Node) -> None:
    called = []
    guards = [node.create_guard_condition(lambda: called.append(1)) for _ in range(3)]
    for guard in guards:
        guard.trigger()
    for count in range(1, 4):
        executor.spin_once(timeout_sec=DEADLINE)
        assert len(called) == count


def test_a_node_is_added_once(executor: Executor, node: Node) -> None:
    assert executor.add_node(node) is False
    assert node.executor is executor
    assert executor.get_nodes() == [node]


def test_a_removed_node_is_not_executed(
    executor: Executor, node: Node, spin_for: Callable[[float], None]
) -> None:
    called = []
    node.create_timer(0.001, lambda: called.append(1))
    executor.remove_node(node)
    spin_for(0.05)
    assert called == []
    assert executor.get_nodes() == []


def test_a_node_moves_to_another_executor(
    executor: Executor, node: Node, context: Context, until: Until
) -> None:
    called = []
    guard = node.create_guard_condition(lambda: called.append(1))
    until_now = SingleThreadedExecutor(context=context)
    executor.remove_node(node)
    until_now.add_node(node)
    guard.trigger()
    until_now.spin_once(timeout_sec=DEADLINE)
    assert len(called) == 1

    until_now.remove_node(node)
    guard.trigger()
    executor.add_node(node)
    until(lambda: len(called) == 2)
    until_now.shutdown()


def test_nodes_and_entities_added_during_a_spin_are_executed(
    executor: Executor, make_node: Callable[[], Node]
) -> None:
    done = Future()
    first = make_node()

    def add() -> None:
        timer.cancel()
        second = make_node()
        second.create_timer(0.001, lambda: done.done() or done.set_result(1))

    timer = first.create_timer(0.001, add)
    executor.spin_until_future_complete(done, DEADLINE)
    assert done.done()


@pytest.mark.parametrize('timeout', [None, -1.0, 0.0, 1.0])
def test_a_future_that_is_done_ends_a_spin_before_it_begins(
    executor: Executor, node: Node, timeout: float | None
) -> None:
    future = Future()
    future.set_result(1)
    called = []
    node.create_guard_condition(lambda: called.append(1)).trigger()
    executor.spin_until_future_complete(future, timeout)
    assert called == []


def test_a_spin_ends_with_its_timeout(executor: Executor, node: Node) -> None:
    node.create_timer(0.001, lambda: None)
    future = Future()
    begin = time.monotonic()
    executor.spin_until_future_complete(future, 0.05)
    assert time.monotonic() - begin >= 0.05
    executor.spin_until_future_complete(future, 0.0)
    assert not future.done()


@pytest.mark.parametrize('cancelled', [False, True], ids=['done', 'cancelled'])
def test_a_future_of_another_thread_ends_a_spin_without_a_timeout(
    executor: Executor, *, cancelled: bool
) -> None:
    future = Future(executor=executor)
    timer = threading.Timer(0.02, future.cancel if cancelled else lambda: future.set_result(1))
    timer.start()
    executor.spin_until_future_complete(future)
    timer.join()
    assert future.cancelled() is cancelled


def test_shutdown_by_another_thread_ends_spin(executor: Executor, node: Node) -> None:
    begun = threading.Event()
    node.create_guard_condition(begun.set).trigger()
    thread = in_thread(executor.spin)
    assert begun.wait(DEADLINE)
    executor.shutdown()
    thread.join(DEADLINE)
    assert not thread.is_alive()


def test_shutdown_by_a_callback_ends_spin(executor: Executor, node: Node) -> None:
    node.create_guard_condition(lambda: executor.shutdown(timeout_sec=0)).trigger()
    thread = in_thread(executor.spin)
    thread.join(DEADLINE)
    assert not thread.is_alive()


def test_the_end_of_the_context_ends_spin(
    ros_domain: int, make_executor: Callable[[Context], Executor]
) -> None:
    context = Context()
    context.init(domain_id=ros_domain)
    executor = make_executor(context)
    node = Node('node', context=context, start_parameter_services=False, enable_rosout=False)
    executor.add_node(node)

    node.create_guard_condition(context.shutdown).trigger()
    try:
        executor.spin()
    except ExternalShutdownException:  # of SingleThreadedExecutor
        assert isinstance(executor, SingleThreadedExecutor)

    executor.shutdown()
    node.destroy_node()


def test_after_shutdown_nothing_is_executed(executor: Executor, node: Node) -> None:
    called = []
    node.create_guard_condition(lambda: called.append(1)).trigger()
    assert executor.shutdown() is True
    executor.spin()
    executor.spin_until_future_complete(Future(), 0.01)
    assert called == []
    assert executor.get_nodes() == []


def test_an_executor_is_a_context_manager(
    context: Context, make_executor: Callable[[Context], Executor]
) -> None:
    with make_executor(context) as executor:
        done = executor.create_task(lambda: 1)
        executor.spin_until_future_complete(done, DEADLINE)
    executor.spin()
    assert done.result() == 1


def test_an_exception_of_a_callback_is_raised_and_the_next_spin_works(
    node: Node, until: Until
) -> None:
    def fail() -> None:
        raise ZeroDivisionError('of the test')

    called = []
    failing = node.create_guard_condition(fail)
    other = node.create_guard_condition(lambda: called.append(1))
    failing.trigger()
    with pytest.raises(ZeroDivisionError, match='of the test'):
        until(lambda: False)
    other.trigger()
    until(lambda: called)


def test_a_callback_is_waited_for_and_executed_by_hand(executor: Executor, node: Node) -> None:
    called = []
    timer = node.create_timer(0.001, lambda: called.append(1))
    while not called:
        handler, entity, owner = executor.wait_for_ready_callbacks(timeout_sec=DEADLINE)
        handler()
        assert (entity, owner) == (timer, node)
    with pytest.raises(ConditionReachedException):
        executor.wait_for_ready_callbacks(DEADLINE, None, lambda: True)

    timer.cancel()
    wait_until_nothing_is_ready(executor)


def wait_until_nothing_is_ready(executor: Executor) -> None:
    """Execute by hand what is left; fail if that never ends."""
    for _ in range(1000):
        with suppress(TimeoutException):
            executor.wait_for_ready_callbacks(timeout_sec=0.001)[0]()
            continue
        return
    pytest.fail('something is ready again and again')


def test_a_wait_by_hand_after_shutdown_raises(executor: Executor) -> None:
    executor.shutdown()
    with pytest.raises(ShutdownException):
        executor.wait_for_ready_callbacks()


def test_waits_by_hand_and_spins_follow_one_another(
    executor: Executor, node: Node, until: Until
) -> None:
    received = []
    publisher = node.create_publisher(Int32, 'number', 10)
    node.create_subscription(Int32, 'number', lambda message: received.append(message.data), 10)
    guard = node.create_guard_condition(lambda: received.append(0))
    until(publisher.get_subscription_count)

    def receive_by_hand(count: int) -> None:
        while len(received) < count:
            executor.wait_for_ready_callbacks(timeout_sec=DEADLINE)[0]()

    for number in (1, 4, 7):
        publisher.publish(Int32(data=number))
        receive_by_hand(number)
        task = executor.create_task(lambda: 'by hand')
        while not task.done():
            executor.wait_for_ready_callbacks(timeout_sec=DEADLINE)[0]()
        publisher.publish(Int32(data=number + 1))
        until(lambda number=number: len(received) == number + 1)
        guard.trigger()
        until(lambda number=number: len(received) == number + 2)

    assert received == [1, 2, 0, 4, 5, 0, 7, 8, 0]


@pytest.mark.parametrize('by_hand', [False, True], ids=['spin_once', 'wait_for_ready_callbacks'])
def test_wake_and_shutdown_reach_a_thread_that_waits(executor: Executor, *, by_hand: bool) -> None:
    def wait() -> None:
        if by_hand:
            with pytest.raises(ShutdownException):
                executor.wait_for_ready_callbacks()
        else:
            executor.spin_once()

    thread = in_thread(wait)
    time.sleep(0.02)  # also a thread that does not wait yet has to end
    executor.wake()
    executor.shutdown()
    thread.join(DEADLINE)
    assert not thread.is_alive()
