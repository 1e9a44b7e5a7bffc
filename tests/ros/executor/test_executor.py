"""The executor does without what is missing, and leaves rclpy and the process as they are."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from builtin_interfaces.msg import Time
from rclpy.node import Node

from barc_sim.ros.executor import QuickExecutor, rclpy_private

if TYPE_CHECKING:
    from rclpy.context import Context

pytestmark = pytest.mark.timeout(60)

USE = """if True:
    import warnings
    from importlib import import_module
    import rclpy.executors
    {lose}
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


def run(program: str) -> list[str]:
    """Return the lines that a program in a process of its own prints."""
    return subprocess.run(
        [sys.executable, '-c', program], check=True, stdout=subprocess.PIPE, text=True, timeout=50
    ).stdout.splitlines()


def test_nothing_is_warned_of_where_all_names_are_there(ros_domain: int) -> None:
    del ros_domain  # by the environment
    assert run(USE.format(lose='')) == ['works']


@pytest.mark.parametrize(
    ('lose', 'name'),
    [
        ('del rclpy.executors.Executor._take_waitable', 'MultiThreadedExecutor._take_waitable'),
        ("del import_module('rclpy.task').Future.remove_done_callback", 'remove_done_callback'),
        ("del import_module('os').eventfd", 'os.eventfd'),
        ("del import_module('select').epoll", 'select.epoll'),
    ],
)
def test_what_is_missing_is_named_once_and_rclpys_own_executor_does_the_work(
    ros_domain: int, lose: str, name: str
) -> None:
    del ros_domain  # by the environment
    warning, works = run(USE.format(lose=lose))
    assert name in warning
    assert works == 'works'


LOSE_EACH = """if True:
    import os
    import warnings
    from pkgutil import resolve_name
    from barc_sim.ros.executor.rclpy_private import PRIVATE_NAMES
    import sys
    for name in [name for name in sys.modules if name.startswith('barc_sim.ros')]:
        del sys.modules[name]

    def lose(owner, name):
        if name in vars(owner):
            vars(owner).get('_member_map_', {}).pop(name, None)  # of an Enum
            (type.__delattr__ if hasattr(owner, '__members__') else delattr)(owner, name)
        for each in list(vars(owner).values()):
            each = getattr(each, 'fset', each)
            if hasattr(each, '__code__') and name in each.__code__.co_names:
                names = tuple('gone' if n == name else n for n in each.__code__.co_names)
                each.__code__ = each.__code__.replace(co_names=names)

    for path, name in [(p, name) for p, names in PRIVATE_NAMES.items() for name in names.split()]:
        if os.fork():
            os.wait()
            continue
        owner = resolve_name(path)
        lose(next((c for c in getattr(owner, '__mro__', ()) if name in vars(c)), owner), name)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter('always')
            from barc_sim.ros.executor import QuickExecutor
        warned = [str(each.message) for each in caught if 'QuickExecutor' in str(each.message)]
        print(len(warned) == 1 and name in warned[0], path, name, warned, flush=True)
        os._exit(0)
"""


def test_every_private_name_is_checked_before_it_is_used() -> None:
    lines = run(LOSE_EACH)
    assert len(lines) == sum(len(each.split()) for each in rclpy_private.PRIVATE_NAMES.values())
    assert [line for line in lines if not line.startswith('True')] == []


UNTOUCHED = """if True:
    import resource
    import rclpy.executors
    from rclpy.node import Node

    def state():
        classes = {c for m in list(sys.modules.values()) if m.__name__.startswith('rclpy')
                   for c in vars(m).values() if isinstance(c, type)}
        limit = resource.getrlimit(resource.RLIMIT_NOFILE)
        return {c: dict(vars(c)) for c in classes if c.__module__.startswith('rclpy')}, limit

    import sys
    rclpy.init()
    node = Node('tested')
    node.create_timer(0.001, lambda: None)
    entity = node.create_guard_condition(print)
    handle = entity.handle
    with rclpy.executors.MultiThreadedExecutor(2) as executor:
        executor.add_node(node)
        executor.spin_once()
    import builtin_interfaces.msg, rclpy.action
    before = state()
    from barc_sim.ros.executor import QuickExecutor
    with QuickExecutor(2) as executor:
        executor.add_node(node)
        executor.spin_once()
    after = state()
    print(all(after[0][c] == before[0][c] for c in before[0]) and before[1] == after[1])
    print(entity.handle is handle and 'destroy' not in vars(entity))
"""


def test_neither_rclpys_classes_nor_the_process_nor_former_entities_are_changed(
    ros_domain: int,
) -> None:
    del ros_domain  # by the environment
    assert run(UNTOUCHED) == ['True', 'True']


def test_a_middleware_without_listeners_is_waited_for_in_a_wait_set(
    ros: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rclpy_private, '_setter', lambda _: lambda *_: 1)
    node = Node('tested', context=ros)
    received: list[Time] = []
    for _ in range(2):
        node.create_subscription(Time, 'a', received.append, 10)
    with QuickExecutor(2, context=ros) as executor:
        executor.add_node(node)
        publisher = node.create_publisher(Time, 'a', 10)
        for number in range(1, 4):
            publisher.publish(Time(sec=number))
            while len(received) < 2 * number:
                executor.spin_once(timeout_sec=1.0)
    node.destroy_node()

    assert sorted(message.sec for message in received) == [1, 1, 2, 2, 3, 3]
