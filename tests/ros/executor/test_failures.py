"""An exception in a callback ends the spin at once, with the callback's traceback."""

from __future__ import annotations

import threading
import traceback
from contextlib import suppress
from typing import TYPE_CHECKING

import pytest
from builtin_interfaces.msg import Time
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.callback_groups import CallbackGroup
    from rclpy.node import Node

    from barc_sim.ros.executor import QuickExecutor

    Until = Callable[[Callable[[], object]], None]

pytestmark = pytest.mark.timeout(60)
GROUPS = pytest.mark.parametrize(
    'group_type', [ReentrantCallbackGroup, MutuallyExclusiveCallbackGroup]
)


class BrokenError(Exception):
    """What the callbacks of these tests raise."""


def break_down(*_: object) -> None:
    raise BrokenError


async def break_down_awaiting(*_: object) -> None:
    raise BrokenError


def spin_until_broken(executor: QuickExecutor) -> list[str]:
    """Spin; return the names of the functions in the traceback."""
    with pytest.raises(BrokenError) as raised:
        executor.spin()
    return [frame.name for frame in traceback.extract_tb(raised.value.__traceback__)]


@pytest.mark.parametrize('callback', [break_down, break_down_awaiting])
def test_of_a_timer(
    node: Node,
    executor: QuickExecutor,
    callback: Callable[..., object],
) -> None:
    timer = node.create_timer(0.001, callback)
    assert spin_until_broken(executor)[-1] == callback.__name__
    timer.cancel()


def test_after_waiting_for_a_future(node: Node, executor: QuickExecutor) -> None:
    future = executor.create_task(lambda: None)

    async def wait_and_break_down() -> None:
        await future
        break_down()

    guard = node.create_guard_condition(wait_and_break_down)
    guard.trigger()
    assert spin_until_broken(executor)[-2:] == ['wait_and_break_down', 'break_down']


@pytest.mark.parametrize('error', [SystemExit, KeyboardInterrupt])
def test_that_is_to_end_the_process(executor: QuickExecutor, error: type[BaseException]) -> None:
    def end() -> None:
        raise error

    executor.create_task(end)
    with pytest.raises(error):
        executor.spin()


def test_of_a_task_beside_busy_callbacks(node: Node, executor: QuickExecutor) -> None:
    guard = node.create_guard_condition(lambda: guard.trigger())  # noqa: PLW0108
    guard.trigger()
    executor.create_task(break_down)
    assert spin_until_broken(executor)[-1] == 'break_down'


def test_that_comes_while_nothing_else_is_ready(node: Node, executor: QuickExecutor) -> None:
    waits = threading.Event()
    node.create_timer(1e-3, lambda: (waits.wait(0.05), break_down()))
    assert spin_until_broken(executor)[-1] == 'break_down'


@GROUPS
def test_leaves_the_executor_and_the_group_usable(
    node: Node, executor: QuickExecutor, until: Until, group_type: type[CallbackGroup]
) -> None:
    group = group_type()
    timer = node.create_timer(0.001, break_down, callback_group=group)
    spin_until_broken(executor)
    timer.cancel()
    for _ in range(10):  # further calls that had been handed off
        with suppress(BrokenError):
            executor.spin_once(timeout_sec=0)
    ticks = []
    node.create_timer(0.001, lambda: ticks.append(1), callback_group=group)
    until(lambda: ticks)


def test_one_of_many_is_raised_by_each_spin(executor: QuickExecutor, node: Node) -> None:
    node.create_subscription(Time, 'a', break_down, 10)
    publisher = node.create_publisher(Time, 'a', 10)
    for _ in range(3):
        publisher.publish(Time())
    for _ in range(3):
        spin_until_broken(executor)
    executor.spin_once(timeout_sec=0)
