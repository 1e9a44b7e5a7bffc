"""Spins end when they should; the executor leaves nothing behind, and rclpy as it is."""

# ruff: noqa: SLF001 - rclpy's private names are the point.

from __future__ import annotations

import gc
import signal
import subprocess
import sys
import threading
import time
import weakref
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import rclpy
from builtin_interfaces.msg import Time
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Empty

from barc_sim.ros.executor import QuickExecutor, rcl, rclpy_private

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context

    Until = Callable[[Callable[[], object]], None]


pytestmark = pytest.mark.timeout(300)
DEADLINE = 100.0
PROGRAMS = Path(__file__).with_name('programs')


def test_spin_once_executes_one_callback(node: Node, executor: QuickExecutor) -> None:
    calls = []
    group = MutuallyExclusiveCallbackGroup()
    for name in 'ab':
        guard = node.create_guard_condition(
            lambda name=name: calls.append(name), callback_group=group
        )
        guard.trigger()

    executor.spin_once(timeout_sec=DEADLINE)
    assert len(calls) == 1
    executor.spin_once(timeout_sec=DEADLINE)
    assert sorted(calls) == ['a', 'b']


def test_wakes_do_not_prolong_a_spin(node: Node, executor: QuickExecutor) -> None:
    ended = threading.Event()

    def disturb() -> None:
        while not ended.wait(0.001):
            node.create_guard_condition(lambda: None)

    thread = threading.Thread(target=disturb)
    thread.start()
    executor.spin_once(timeout_sec=0.1)
    ended.set()
    thread.join()


def test_spin_until_future_complete_ends_with_a_future_of_another_thread(
    executor: QuickExecutor,
) -> None:
    future = Future()
    thread = threading.Thread(target=future.set_result, args=(1,))
    thread.start()
    executor.spin_until_future_complete(future)
    thread.join()
    assert future.result() == 1


def test_a_callback_shuts_the_executor_down(node: Node, executor: QuickExecutor) -> None:
    returned = []
    node.create_timer(0.001, lambda: returned.append(executor.shutdown()))
    executor.spin()
    assert executor.shutdown()
    assert len(returned) == 1


def test_a_callback_shuts_the_context_down(
    node: Node, executor: QuickExecutor, ros: Context
) -> None:
    node.create_timer(0.001, ros.try_shutdown)
    executor.spin()
    assert not ros.ok()


def test_shutdown_by_another_thread_waits_for_callbacks(
    node: Node, executor: QuickExecutor
) -> None:
    begun = threading.Event()
    release = threading.Event()
    ended = []

    def work() -> None:
        begun.set()
        release.wait(DEADLINE)
        ended.append(1)

    node.create_timer(0.001, work)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    assert begun.wait(DEADLINE)

    assert not executor.shutdown(timeout_sec=0.01)
    assert not executor.shutdown(wait_for_threads=False)
    release.set()
    assert executor.shutdown()
    assert ended
    thread.join(DEADLINE)
    assert not thread.is_alive()


def test_an_exception_after_the_last_spin_is_printed(
    executor: QuickExecutor, capsys: pytest.CaptureFixture[str]
) -> None:
    begun = threading.Event()
    release = threading.Event()

    def fail() -> None:
        begun.set()
        release.wait(DEADLINE)
        raise ValueError('too late')

    executor.create_task(fail)
    executor.spin_once(timeout_sec=DEADLINE)
    assert begun.wait(DEADLINE)
    assert not executor.shutdown(timeout_sec=0)
    release.set()
    executor.shutdown()

    assert capsys.readouterr().err.endswith('ValueError: too late\n')


@pytest.mark.parametrize('spins', [0, 5])
def test_nothing_is_left_after_shutdown(ros: Context, spins: int) -> None:
    threads = set(threading.enumerate())
    executor = QuickExecutor(4, context=ros)
    node = Node('tested', context=ros)
    executor.add_node(node)
    entities = (
        node.create_subscription(Time, 'a', lambda _: None, 1),
        node.create_timer(0.001, lambda: None),
        node.create_guard_condition(lambda: None),
        *node.services,
    )
    for _ in range(spins):
        executor.spin_once(timeout_sec=1.0)

    executor.shutdown()
    node.destroy_node()

    assert not any(entity.handle.pointer for entity in entities)
    assert set(threading.enumerate()) <= threads
    gone = weakref.ref(executor)
    del executor
    gc.collect()
    assert gone() is None


def test_a_deleted_executor_releases_its_handles(ros: Context) -> None:
    executor = QuickExecutor(2, context=ros)
    node = Node('tested', context=ros)
    executor.add_node(node)
    timer = node.create_timer(1.0, lambda: None)
    executor.spin_once(timeout_sec=0)
    del executor
    gc.collect()

    node.destroy_node()

    assert not timer.handle.pointer


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_spin(ros_domain: int, number: signal.Signals) -> None:
    del ros_domain  # by the environment
    with subprocess.Popen(
        [sys.executable, PROGRAMS / 'spin_until_signal.py'],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout.readline() == 'spinning\n'
        process.send_signal(number)
        output, errors = process.communicate(timeout=DEADLINE)

    assert output.endswith('ended\n')
    assert errors == ''
    assert process.returncode == 0


def test_a_spin_in_a_daemon_does_not_keep_a_program_from_ending(ros_domain: int) -> None:
    del ros_domain  # by the environment
    assert run('spin_in_daemon.py') == ['True']


def test_rclpys_own_functions_spin_it(node: Node, executor: QuickExecutor) -> None:
    calls = []
    node.create_timer(
        0.001, lambda: calls.append(1), callback_group=MutuallyExclusiveCallbackGroup()
    )
    rclpy.spin_once(node, executor=executor, timeout_sec=DEADLINE)
    rclpy.spin_until_future_complete(node, Future(), executor=executor, timeout_sec=0.05)
    assert len(calls) > 1


@pytest.mark.parametrize('threads', [1, 3])
@pytest.mark.parametrize('spun', ['for ever', 'once', 'once, in a time'])
@pytest.mark.filterwarnings('ignore:MultiThreadedExecutor is used with a single thread')
def test_a_callback_can_spin_until_its_response_arrives(
    ros: Context, threads: int, spun: str
) -> None:
    executor, node = QuickExecutor(threads, context=ros), Node('tested', context=ros)
    executor.add_node(node)
    answered = Future()
    groups = [MutuallyExclusiveCallbackGroup() for _ in range(3)]
    node.create_service(Empty, 'serve', lambda _, answer: answer, callback_group=groups[0])
    client = node.create_client(Empty, 'serve', callback_group=groups[1])
    assert client.wait_for_service(DEADLINE)

    def ask() -> None:
        timer.cancel()
        answer = client.call_async(Empty.Request())
        executor.spin_until_future_complete(answer, DEADLINE)
        answered.set_result(answer.done())

    timer = node.create_timer(0.001, ask, callback_group=groups[2])
    if spun == 'for ever':
        executor.spin_until_future_complete(answered, DEADLINE)
    while not answered.done():
        executor.spin_once(DEADLINE if 'time' in spun else None)
    executor.shutdown()
    node.destroy_node()

    assert answered.result()


def test_a_spin_ends_in_time_while_all_threads_are_in_callbacks(
    node: Node, executor: QuickExecutor
) -> None:
    release = threading.Event()
    begun = []

    def block() -> None:
        begun.append(1)
        release.wait(DEADLINE)

    for _ in range(4):  # as many as there are threads
        node.create_guard_condition(
            block, callback_group=MutuallyExclusiveCallbackGroup()
        ).trigger()
    executor.spin_until_future_complete(Future(), 0.2)
    assert len(begun) == 4

    future = Future()
    threading.Thread(target=future.set_result, args=(1,)).start()
    executor.spin_until_future_complete(future)
    for _ in range(5):
        executor.spin_once(timeout_sec=0.01)
    assert not release.is_set()

    release.set()


def test_an_exception_ends_the_spin_while_another_callback_lasts(
    node: Node, executor: QuickExecutor
) -> None:
    release = threading.Event()
    groups = [MutuallyExclusiveCallbackGroup() for _ in range(2)]
    blocker = node.create_guard_condition(lambda: release.wait(DEADLINE), callback_group=groups[0])
    node.create_timer(0.02, lambda: 1 / 0, callback_group=groups[1])
    blocker.trigger()

    with pytest.raises(ZeroDivisionError):
        executor.spin()

    assert not release.is_set()
    release.set()


def test_spins_follow_one_another_while_callbacks_last(node: Node, executor: QuickExecutor) -> None:
    """Whoever leads at a spin's end, the next spin goes on."""
    calls = [0, 0]

    def work(number: int) -> None:
        calls[number] += 1
        time.sleep(0.0015 * (calls[number] % 3))

    for number in range(2):
        node.create_timer(
            0.0005,
            lambda number=number: work(number),
            callback_group=MutuallyExclusiveCallbackGroup(),
        )
    for round_ in range(300):
        if round_ % 3:
            executor.spin_once(DEADLINE if round_ % 2 else None)
        else:
            executor.spin_until_future_complete(Future(), 0.002)
    before = list(calls)
    executor.spin_until_future_complete(Future(), 0.2)

    assert all(after > count for after, count in zip(calls, before, strict=True))


@pytest.mark.filterwarnings('error')
def test_one_thread_gives_no_warning(ros: Context) -> None:
    with QuickExecutor(1, context=ros) as executor:
        task = executor.create_task(lambda: 1)
        executor.spin_until_future_complete(task, DEADLINE)
    assert task.result() == 1


@pytest.mark.filterwarnings('error')
def test_a_deletion_after_the_handles_prints_nothing(ros: Context) -> None:
    node = Node('tested', context=ros, start_parameter_services=False)
    node.create_timer(3600.0, print)
    executor = QuickExecutor(2, context=ros)
    executor.add_node(node)
    executor.spin_once(timeout_sec=0)

    executor._sigint_gc.destroy()
    node.get_clock().handle.destroy_when_not_in_use()
    node.destroy_node()
    executor.__del__()  # an error would be ignored with a traceback
    executor._sigint_gc = None


def test_a_coroutine_waits_while_its_node_is_not_in_the_executor(
    ros: Context, executor: QuickExecutor, node: Node
) -> None:
    assert ros.ok()
    future = Future()
    order = []

    async def wait() -> None:
        order.append('begun')
        await future
        order.append('ended')

    node.create_guard_condition(wait).trigger()
    while not order:
        executor.spin_once(timeout_sec=0.05)
    executor.remove_node(node)
    future.set_result(1)
    executor.spin_until_future_complete(Future(), 0.05)
    assert order == ['begun']

    executor.add_node(node)
    end = time.monotonic() + DEADLINE
    while len(order) < 2 and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
    assert order == ['begun', 'ended']


def run(program: str, *arguments: str) -> list[str]:
    """Return the lines that a program in a process of its own prints."""
    return subprocess.run(
        [sys.executable, PROGRAMS / program, *arguments],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
        timeout=200,
    ).stdout.splitlines()


@pytest.mark.parametrize(
    ('arguments', 'name'),
    [
        ([], ''),
        (
            ['name', 'rclpy.executors:Executor', '_take_waitable'],
            'MultiThreadedExecutor._take_waitable',
        ),
        (['name', 'rclpy.task:Future', 'remove_done_callback'], 'remove_done_callback'),
        (['name', 'os', 'eventfd'], 'os.eventfd'),
        (['name', 'select', 'epoll'], 'select.epoll'),
        (['version', '9.1.2'], 'rclpy 9.1.2'),
        (['version', '7.1.12'], ''),
    ],
)
def test_one_warning_names_what_is_missing_and_rclpys_executor_runs(
    ros_domain: int, arguments: list[str], name: str
) -> None:
    del ros_domain  # by the environment
    *warnings, works = run('use_without.py', *arguments)
    assert [name in warning for warning in warnings] == [True] * bool(name)
    assert works == 'works'


def test_every_private_name_is_checked_before_it_is_used() -> None:
    lines = run('lose_each_name.py')
    assert len(lines) == sum(len(names) for names in rclpy_private.PRIVATE_NAMES.values())
    assert [line for line in lines if not line.startswith('True')] == []


def test_neither_rclpys_classes_nor_the_process_nor_former_entities_are_changed(
    ros_domain: int,
) -> None:
    del ros_domain  # by the environment
    assert run('change_nothing.py') == ['True', 'True', 'True']


def test_messages_arrive_without_listeners_in_the_middleware(
    ros: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rcl, '_setter', lambda _: lambda *_: 1)
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
