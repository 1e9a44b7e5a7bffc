"""Entities of every kind are executed, added, removed and destroyed, as in rclpy."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import pytest
from builtin_interfaces.msg import Time
from rcl_interfaces.srv import ListParameters
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context
    from rclpy.node import Node

    from barc_sim.ros.executor import QuickExecutor

    Until = Callable[[Callable[[], object]], None]

pytestmark = pytest.mark.timeout(120)
DEADLINE = 20.0


def test_a_subscription_gets_the_message_or_its_information_too(node: Node, until: Until) -> None:
    alone = []
    with_information = []
    raw = []
    node.create_subscription(Time, 'a', alone.append, 10)
    node.create_subscription(
        Time,
        'a',
        lambda message, information: with_information.append((message, information)),
        10,
    )
    node.create_subscription(Time, 'a', raw.append, 10, raw=True)
    node.create_publisher(Time, 'a', 10).publish(Time(sec=7))

    until(lambda: alone and with_information and raw)

    assert alone == [Time(sec=7)]
    message, information = with_information[0]
    assert message == Time(sec=7)
    assert information['source_timestamp'] > 0
    assert deserialize_message(raw[0], Time) == Time(sec=7)


def test_a_guard_condition_is_executed_once_for_a_trigger(
    node: Node, executor: QuickExecutor, until: Until
) -> None:
    calls = []
    guard = node.create_guard_condition(lambda: calls.append(1))
    for number in range(1, 4):
        guard.trigger()
        until(lambda number=number: len(calls) == number)
        executor.spin_once(timeout_sec=0)
    assert len(calls) == 3


def test_quality_of_service_events_are_executed(node: Node, until: Until) -> None:
    events = []
    node.create_subscription(
        Time,
        'a',
        lambda _: None,
        QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE),
        event_callbacks=SubscriptionEventCallbacks(incompatible_qos=events.append),
    )
    node.create_publisher(Time, 'a', QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))

    until(lambda: events)

    assert events[0].total_count == 1


def test_nodes_come_and_go_while_spinning(
    make_node: Callable[..., Node], executor: QuickExecutor, spinning: threading.Thread
) -> None:
    other = make_node('other')
    ticked = threading.Event()
    other.create_timer(0.0001, ticked.set, callback_group=MutuallyExclusiveCallbackGroup())
    for _ in range(1000):
        executor.remove_node(other)
        assert executor.add_node(other)
    ticked.clear()

    assert ticked.wait(DEADLINE)
    assert spinning.is_alive()


def test_a_removed_node_is_executed_no_longer(
    make_node: Callable[..., Node], executor: QuickExecutor, until: Until
) -> None:
    ticks: dict[str, list[int]] = {'stays': [], 'goes': []}
    for name, each in ticks.items():
        make_node(name).create_timer(0.001, lambda each=each: each.append(1))
    until(lambda: all(ticks.values()))

    executor.remove_node(next(n for n in executor.get_nodes() if n.get_name() == 'goes'))
    until(lambda: len(ticks['stays']) > 3)  # those in the pool have ended
    before = len(ticks['goes'])
    until(lambda: len(ticks['stays']) > 10)

    assert len(ticks['goes']) == before


@pytest.mark.parametrize('kind', ['subscription', 'timer', 'service', 'client', 'guard_condition'])
def test_a_destroyed_handle_is_gone_at_once_between_spins(
    node: Node, executor: QuickExecutor, kind: str
) -> None:
    entity = {
        'subscription': lambda: node.create_subscription(Time, 'a', lambda _: None, 1),
        'timer': lambda: node.create_timer(1.0, lambda: None),
        'service': lambda: node.create_service(ListParameters, 'a', lambda _, answer: answer),
        'client': lambda: node.create_client(ListParameters, 'a'),
        'guard_condition': lambda: node.create_guard_condition(lambda: None),
    }[kind]()
    executor.spin_once(timeout_sec=0)

    assert getattr(node, f'destroy_{kind}')(entity)

    assert not entity.handle.pointer


def test_a_subscription_with_messages_is_destroyed_at_once_and_only_then_left_alone(
    node: Node, executor: QuickExecutor, until: Until
) -> None:
    received: list[Time] = []
    subscription = node.create_subscription(Time, 'a', received.append, 10)
    publisher = node.create_publisher(Time, 'a', 10)
    for expected in (1, 2):
        publisher.publish(Time())
        until(lambda expected=expected: len(received) == expected)
        executor.remove_node(node)
        executor.spin_once(timeout_sec=0)
        assert 'destroy' not in vars(subscription)
        executor.add_node(node)
    publisher.publish(Time())
    until(lambda: len(received) == 3)

    publisher.publish(Time())
    subscription.destroy()
    assert not subscription.handle.pointer
    executor.spin_once(timeout_sec=0)
    assert len(received) == 3
    assert node.destroy_subscription(subscription)


def test_a_destroyed_subscription_leaves_the_graph_while_spinning(
    node: Node, spinning: threading.Thread
) -> None:
    subscription = node.create_subscription(Time, 'a', lambda _: None, 1)
    assert node.count_subscribers('a') == 1
    node.destroy_subscription(subscription)

    left = threading.Event()
    node.create_timer(0.001, lambda: node.count_subscribers('a') or left.set())
    assert left.wait(DEADLINE)
    assert spinning.is_alive()


def test_what_is_destroyed_behind_the_nodes_back_is_not_executed(
    node: Node, executor: QuickExecutor, until: Until
) -> None:
    group = MutuallyExclusiveCallbackGroup()
    calls = []
    subscription = node.create_subscription(Time, 'a', calls.append, 1, callback_group=group)
    timer = node.create_timer(0.001, lambda: calls.append(1), callback_group=group)
    publisher = node.create_publisher(Time, 'a', 1)
    executor.spin_once(timeout_sec=0)
    calls.clear()
    ticks = []
    node.create_timer(0.001, lambda: ticks.append(1), callback_group=group)

    subscription.destroy()
    timer.destroy()
    publisher.publish(Time())
    until(lambda: len(ticks) > 3)

    assert calls == []
    node.destroy_timer(timer)
    node.destroy_subscription(subscription)


def test_a_callback_destroys_what_is_ready_beside_it(node: Node, until: Until) -> None:
    group = MutuallyExclusiveCallbackGroup()
    calls = []

    def fire() -> None:
        calls.append(1)
        for timer in timers:
            timer.cancel()
        while len(timers) > 1:
            node.destroy_timer(timers.pop())

    timers = [node.create_timer(0.0, fire, callback_group=group) for _ in range(5)]
    until(lambda: calls)
    ticks = []
    node.create_timer(0.001, lambda: ticks.append(1), callback_group=group)
    until(lambda: len(ticks) > 3)

    assert len(calls) == 1


def test_a_node_is_destroyed_by_its_own_callback(
    make_node: Callable[..., Node], executor: QuickExecutor, until: Until
) -> None:
    doomed = make_node('doomed')
    calls = []

    def fire() -> None:
        calls.append(1)
        executor.remove_node(doomed)
        doomed.destroy_node()

    doomed.create_timer(0.001, fire, callback_group=MutuallyExclusiveCallbackGroup())
    other = make_node('other')
    ticks = []
    other.create_timer(0.001, lambda: ticks.append(1))
    until(lambda: calls and len(ticks) > 3)

    assert calls == [1]


def test_executors_do_not_keep_a_context_from_ending(
    node: Node, executor: QuickExecutor, ros: Context
) -> None:
    node.create_subscription(Time, 'a', lambda _: None, 1)
    node.create_guard_condition(lambda: None)
    executor.spin_once(timeout_sec=0)
    ros.shutdown()
    executor.spin()  # returns
    assert not ros.ok()
    assert executor.shutdown()


def test_a_cancelled_timer_rests_until_it_is_reset(node: Node, until: Until) -> None:
    calls = []
    timer = node.create_timer(0.001, lambda: calls.append(1))
    other = []
    node.create_timer(
        0.001, lambda: other.append(1), callback_group=MutuallyExclusiveCallbackGroup()
    )
    until(lambda: calls)

    timer.cancel()
    until(lambda: len(other) > 3)  # what had been handed off has ended
    before = len(calls)
    other.clear()
    until(lambda: len(other) > 10)
    assert len(calls) == before

    timer.reset()
    until(lambda: len(calls) > before)


def test_a_changed_period_holds_from_the_next_call(node: Node, until: Until) -> None:
    calls = []
    timer = node.create_timer(1000.0, lambda: calls.append(1))
    timer.timer_period_ns = 1_000_000
    timer.reset()
    until(lambda: len(calls) > 5)


def test_a_timer_cancelled_as_it_is_taken_does_not_end_the_spin(
    node: Node, executor: QuickExecutor, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []
    call = _rclpy.Timer.call_timer  # after the look at whether it is ready

    def cancel_and_call(handle: _rclpy.Timer) -> None:
        timer.cancel()  # as another thread might
        call(handle)

    monkeypatch.setattr(_rclpy.Timer, 'call_timer', cancel_and_call)
    timer = node.create_timer(
        0.001, lambda: calls.append(1), callback_group=MutuallyExclusiveCallbackGroup()
    )
    executor.spin_once(timeout_sec=0.05)

    assert timer.is_canceled()
    assert calls == []


def test_timers_follow_simulated_time_forwards_and_back(
    make_node: Callable[..., Node], until: Until
) -> None:
    node = make_node(parameter_overrides=[Parameter('use_sim_time', value=True)])
    times = []
    clock = node.get_clock()
    node.create_timer(
        1.0,
        lambda: times.append(clock.now().nanoseconds / 1e9),
    )
    publisher = node.create_publisher(Clock, '/clock', 10)

    def set_time(seconds: int) -> None:
        message = Clock()
        message.clock.sec = seconds
        publisher.publish(message)
        until(lambda: clock.now().nanoseconds == seconds * 10**9)

    set_time(1000)
    until(lambda: times)  # from no time to a time is a jump forwards
    times.clear()
    set_time(1001)
    until(lambda: times == [1001])
    set_time(2000)
    until(lambda: len(times) > 1)
    set_time(2000)
    assert times == [1001, 2000], 'once, however many periods have passed'
    set_time(10)
    set_time(12)
    until(lambda: times[-1] == 12)
