"""The executor does without rclpy's private names."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from builtin_interfaces.msg import Time
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node

from barc_sim.ros.executor import QuickExecutor, rclpy_private
from barc_sim.ros.executor.rclpy_private import differing

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context

pytestmark = pytest.mark.timeout(60)

PROGRAM = """if True:
    import warnings
    from rclpy.executors import Executor, MultiThreadedExecutor
    for name in ({names}):
        delattr(Executor, name)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        from barc_sim.ros.executor import QuickExecutor
    for each in caught:
        if 'QuickExecutor' in str(each.message):
            print(each.message)
    import rclpy
    from rclpy.node import Node
    rclpy.init()
    node = Node('tested')
    ticks = []
    node.create_timer(0.001, lambda: ticks.append(1))
    with QuickExecutor(2) as executor:
        executor.add_node(node)
        while not ticks:
            executor.spin_once(timeout_sec=1.0)
        node.create_timer(0.001, lambda: 1 / 0)
        try:
            executor.spin()
        except ZeroDivisionError:
            print('works')
    node.destroy_node()
    rclpy.shutdown()
"""


def run(*names: str) -> list[str]:
    """Use the executor in a process whose rclpy lacks the names; return the lines printed."""
    program = PROGRAM.format(names=''.join(f'{name!r}, ' for name in names))
    process = subprocess.run(
        [sys.executable, '-c', program], check=True, stdout=subprocess.PIPE, text=True, timeout=50
    )
    return process.stdout.splitlines()


def test_this_rclpys_private_names_are_as_they_were() -> None:
    assert differing() == []


def test_nothing_is_warned_of_where_all_names_are_there(ros_domain: int) -> None:
    del ros_domain  # by the environment
    assert run() == ['works']


def test_a_missing_private_name_is_warned_of_once_and_rclpys_own_way_is_gone(
    ros_domain: int,
) -> None:
    del ros_domain  # by the environment
    warning, works = run('_take_client')
    assert 'MultiThreadedExecutor._take_client' in warning
    assert works == 'works'


@pytest.mark.parametrize(
    'other', [lambda _, guard: guard.callback, lambda *_: None, lambda *_: lambda: None]
)
def test_a_private_name_that_behaves_differently_is_found(
    monkeypatch: pytest.MonkeyPatch, other: Callable[..., object]
) -> None:
    monkeypatch.setattr(MultiThreadedExecutor, '_take_guard_condition', other)

    assert differing() == ['_take_guard_condition as in Jazzy']


def test_messages_that_cannot_be_converted_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(type(Time), '_CONVERT_TO_PY', None)

    assert differing() == ['_CONVERT_TO_PY as in Jazzy']


def test_a_middleware_without_listeners_is_waited_for_in_a_wait_set(
    ros: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rclpy_private, '_setter', lambda _: lambda *_: 1)
    node = Node('tested', context=ros)
    received: list[Time] = []
    node.create_subscription(
        Time, 'a', received.append, 10, callback_group=MutuallyExclusiveCallbackGroup()
    )
    node.create_subscription(Time, 'a', received.append, 10)
    with QuickExecutor(2, context=ros) as executor:
        with pytest.warns(UserWarning, match='the middleware has no listeners'):
            executor.add_node(node)
        publisher = node.create_publisher(Time, 'a', 10)
        for number in range(1, 4):
            publisher.publish(Time(sec=number))
            while len(received) < 2 * number:
                executor.spin_once(timeout_sec=1.0)
    node.destroy_node()

    assert sorted(message.sec for message in received) == [1, 1, 2, 2, 3, 3]
