"""Arrivals are counted in descriptors: none is lost, none is left, none is used too early."""

from __future__ import annotations

import os
import threading
from contextlib import suppress
from ctypes import c_int32
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from builtin_interfaces.msg import Time
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

from barc_sim.ros.executor import QuickExecutor
from barc_sim.ros.executor.rclpy_private import set_listener
from barc_sim.ros.polled import PolledCallbackGroup

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context

    Until = Callable[[Callable[[], object]], None]

pytestmark = pytest.mark.timeout(120)
DEADLINE = 20.0


def descriptors() -> int:
    """Return how many files this process has open."""
    return len(list(Path('/proc/self/fd').iterdir()))


def test_messages_that_arrived_before_the_node_was_added_are_received(
    ros: Context, executor: QuickExecutor, until: Until
) -> None:
    node = Node('early', context=ros)
    received: list[int] = []
    node.create_subscription(Time, 'a', lambda message: received.append(message.sec), 10)
    publisher = node.create_publisher(Time, 'a', 10)
    for number in range(3):
        publisher.publish(Time(sec=number))

    executor.add_node(node)
    until(lambda: len(received) == 3)
    node.destroy_node()

    assert received == [0, 1, 2]


@pytest.mark.parametrize('other', [QuickExecutor, MultiThreadedExecutor])
def test_messages_that_wait_when_a_node_is_removed_are_received_by_the_next_executor(
    node: Node, executor: QuickExecutor, ros: Context, other: type[MultiThreadedExecutor]
) -> None:
    received: list[int] = []
    node.create_subscription(
        Time, 'a', lambda message: received.append(message.sec), 10, callback_group=None
    )
    guard = node.create_guard_condition(lambda: received.append(-1))
    publisher = node.create_publisher(Time, 'a', 10)
    executor.spin_once(timeout_sec=0)
    for number in range(3):
        publisher.publish(Time(sec=number))
    guard.trigger()

    executor.remove_node(node)
    with other(2, context=ros) as another:
        another.add_node(node)
        while len(received) < 4:
            another.spin_once(timeout_sec=0.05)  # rclpy's does not end with a callback
        another.remove_node(node)

    assert sorted(received) == [-1, 0, 1, 2]


def test_a_trigger_that_was_handed_on_before_the_node_was_added_wakes_the_executor(
    ros: Context, executor: QuickExecutor, spinning: threading.Thread
) -> None:
    node = Node('early', context=ros)
    called = threading.Event()
    trigger = node.create_guard_condition(called.set).trigger
    executor.add_node(node)

    trigger()

    assert called.wait(DEADLINE)
    assert spinning.is_alive()
    executor.remove_node(node)
    node.destroy_node()


def test_no_descriptor_is_left(ros: Context) -> None:
    def use() -> None:
        node = Node('tested', context=ros)
        node.create_subscription(Time, 'a', lambda _: None, 10)
        node.create_timer(0.001, lambda: None)
        executor = QuickExecutor(2, context=ros)
        executor.add_node(node)
        executor.spin_once(timeout_sec=DEADLINE)
        executor.shutdown()
        node.destroy_node()

    use()
    before = descriptors()
    for _ in range(5):
        use()
    assert descriptors() <= before


def test_entities_created_and_destroyed_by_several_threads_under_traffic(
    make_node: Callable[..., Node], executor: QuickExecutor, spinning: threading.Thread
) -> None:
    """No descriptor is left, and no message reaches another callback."""
    nodes = [make_node(f'node_{number}') for number in range(3)]
    publishers = [node.create_publisher(Header, f'topic_{i}', 10) for i, node in enumerate(nodes)]
    wrong: list[Header] = []
    received: list[int] = []
    ended = threading.Event()

    def flood() -> None:
        numbered = [(Header(frame_id=str(i)), each) for i, each in enumerate(publishers)]
        while not ended.wait(0.0005):
            for message, publisher in numbered:
                publisher.publish(message)

    def churn(number: int) -> None:
        for round_ in range(300):
            group = MutuallyExclusiveCallbackGroup() if round_ % 2 else None

            def receive(message: Header) -> None:
                (received if message.frame_id == str(number) else wrong).append(number)

            node = nodes[number]
            subscription = node.create_subscription(
                Header, f'topic_{number}', receive, 10, callback_group=group
            )
            timer = node.create_timer(0.0001, lambda: None, callback_group=group)
            guard = node.create_guard_condition(lambda: None, callback_group=group)
            guard.trigger()
            node.destroy_subscription(subscription)
            node.destroy_timer(timer)
            node.destroy_guard_condition(guard)

    def settle() -> None:
        done = threading.Event()
        executor.create_task(done.set)  # begins when the nodes were looked at
        assert done.wait(DEADLINE)

    settle()
    before = descriptors()
    flooding = threading.Thread(target=flood)
    churning = [threading.Thread(target=churn, args=(number,)) for number in range(3)]
    for thread in (flooding, *churning):
        thread.start()
    for thread in churning:
        thread.join()
    ended.set()
    flooding.join()
    settle()

    assert spinning.is_alive()
    assert not wrong
    assert descriptors() <= before + 6  # kept for the next entities


@pytest.mark.parametrize(
    'rounds',
    [500, pytest.param(10_000, marks=[pytest.mark.slow, pytest.mark.timeout(600)])],
)
def test_a_listener_never_writes_into_somebody_elses_descriptor(
    node: Node, spinning: threading.Thread, rounds: int
) -> None:
    """A stranger gets the lowest free numbers while subscriptions come and go under a flood."""
    publisher = node.create_publisher(Time, 'a', 10)
    ended = threading.Event()

    def flood() -> None:
        while not ended.is_set():
            publisher.publish(Time())

    flooding = threading.Thread(target=flood)
    flooding.start()
    touched = 0
    before = descriptors()
    for _ in range(rounds):
        subscription = node.create_subscription(Time, 'a', lambda _: None, 1)
        node.destroy_subscription(subscription)
        stranger = os.eventfd(0, os.EFD_NONBLOCK)
        with suppress(BlockingIOError):
            touched += os.eventfd_read(stranger)
        os.close(stranger)
    ended.set()
    flooding.join()

    assert spinning.is_alive()
    assert touched == 0
    assert descriptors() <= before + 2


def test_idle_endpoints_share_descriptors_and_used_ones_do_not(
    node: Node, executor: QuickExecutor, until: Until
) -> None:
    received: list[int] = []
    before = descriptors()
    for number in range(150):
        node.create_subscription(
            Time, f'topic_{number}', lambda _, number=number: received.append(number), 10
        )
    executor.spin_once(timeout_sec=0)
    idle = descriptors() - before
    publishers = [node.create_publisher(Time, f'topic_{number}', 10) for number in (3, 70)]
    for round_ in range(20):
        for publisher in publishers:
            publisher.publish(Time())
        until(lambda expected=2 * (round_ + 1): len(received) == expected)

    assert idle < 30
    assert sorted(received) == [3] * 20 + [70] * 20


def test_what_arrives_while_busy_and_while_idle_is_received_once(
    node: Node, executor: QuickExecutor, spinning: threading.Thread
) -> None:
    """Arrivals are counted in memory while the executor is busy, and it waits for none there."""
    received: list[int] = []
    paused = threading.Event()

    def answer(message: Time) -> None:
        received.append(message.sec)
        if message.sec % 1000:
            publisher.publish(Time(sec=message.sec + 1))
            publisher.publish(Time())
        elif message.sec:
            paused.set()

    node.create_subscription(Time, 'a', answer, 10)
    publisher = node.create_publisher(Time, 'a', 10)
    for round_ in range(3):
        publisher.publish(Time(sec=1000 * round_ + 1))  # from outside, to one that waits
        assert paused.wait(DEADLINE)
        paused.clear()
        done = threading.Event()
        executor.create_task(done.set)
        assert done.wait(DEADLINE)

    assert spinning.is_alive()
    assert [number for number in received if number] == list(range(1, 3001))
    assert received.count(0) == 3 * 999


def test_messages_that_are_told_of_together_are_counted_one_by_one(node: Node) -> None:
    """DDS tells once of all that a reliable reader held back until a lost one came again."""
    subscription = node.create_subscription(
        Time, 'a', lambda _: None, 10, callback_group=PolledCallbackGroup()
    )
    publisher = node.create_publisher(Time, 'a', 10)
    for number in range(3):
        publisher.publish(Time(sec=number))
    counter = c_int32()

    set_listener(subscription, counter)
    set_listener(subscription, None)

    assert counter.value == 3


def test_a_clock_before_1970_is_warned_of_and_dropped(
    make_node: Callable[..., Node], until: Until, capfd: pytest.CaptureFixture[str]
) -> None:
    node = make_node(parameter_overrides=[Parameter('use_sim_time', value=True)])
    publisher = node.create_publisher(
        Clock, '/clock', QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
    )

    publisher.publish(Clock(clock=Time(sec=-1)))
    until(lambda: 'dropped' in capfd.readouterr().err)
    publisher.publish(Clock(clock=Time(sec=7)))
    until(lambda: node.get_clock().now().nanoseconds == 7 * 10**9)


def test_a_message_that_cannot_be_read_is_warned_of_and_dropped(
    node: Node, until: Until, capfd: pytest.CaptureFixture[str]
) -> None:
    received: list[Time] = []
    subscription = node.create_subscription(Time, 'a', received.append, 10)
    publisher = node.create_publisher(Time, 'a', 10)

    subscription.msg_type = object
    publisher.publish(Time(sec=1))
    until(lambda: 'dropped' in capfd.readouterr().err)
    subscription.msg_type = Time
    publisher.publish(Time(sec=2))
    until(lambda: received)


def test_a_users_exception_below_rclpys_code_ends_the_spin(
    node: Node, executor: QuickExecutor
) -> None:
    def refuse(_: object) -> None:
        raise LookupError

    node.add_on_set_parameters_callback(refuse)
    node.create_timer(0.001, lambda: node.set_parameters([Parameter('use_sim_time', value=False)]))
    with pytest.raises(LookupError):
        executor.spin()


def test_a_busy_thread_and_a_flood_do_not_starve_one_another(node: Node, until: Until) -> None:
    publisher = node.create_publisher(Time, 'a', 10)
    floods: list[int] = []
    counted = [0]
    ended = threading.Event()

    def count() -> None:
        while not ended.is_set():
            counted[0] += 1

    def go_on(message: Time) -> None:
        floods.append(counted[0])
        publisher.publish(message)

    node.create_subscription(Time, 'a', go_on, 10, callback_group=MutuallyExclusiveCallbackGroup())
    publisher.publish(Time())
    thread = threading.Thread(target=count)
    thread.start()
    try:
        until(lambda: len(floods) > 2000 and len(set(floods)) > 20)
    finally:
        ended.set()
        thread.join()
