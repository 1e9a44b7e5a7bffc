"""Entities of every kind are executed, added, removed and destroyed, as in rclpy."""

from __future__ import annotations

import threading
from pathlib import Path
from resource import getpagesize
from typing import TYPE_CHECKING

import pytest
from builtin_interfaces.msg import Time
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterValue
from rcl_interfaces.srv import ListParameters
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.timer import Timer
from rclpy.waitable import NumberOfEntities, Waitable
from std_msgs.msg import String

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context
    from rclpy.impl._rclpy_pybind11 import WaitSet
    from rclpy.node import Node

    from barc_sim.ros.executor import QuickExecutor

    Until = Callable[[Callable[[], object]], None]

pytestmark = pytest.mark.timeout(120)
DEADLINE = 20.0


def test_messages_whose_sequences_grow_and_shrink_arrive_as_they_were(
    node: Node, until: Until
) -> None:
    received: list[ParameterEvent] = []
    node.create_subscription(ParameterEvent, 'a', received.append, 10)
    publisher = node.create_publisher(ParameterEvent, 'a', 10)
    lengths = (0, 3, 50, 2, 0, 1)
    published = [
        ParameterEvent(
            node='n' * length,
            new_parameters=[
                Parameter(
                    name=f'{number}' * length,
                    value=ParameterValue(
                        string_array_value=['s' * other for other in range(number)],
                        double_array_value=[0.5 * length] * number,
                        byte_array_value=[b'b'] * length,
                    ),
                )
                for number in range(length)
            ],
        )
        for length in lengths
    ]

    for message in published:
        publisher.publish(message)
    until(lambda: len(received) == len(published))

    assert received == published  # a later message does not change an earlier one


def test_a_destroyed_subscription_leaves_no_message_in_memory(node: Node, until: Until) -> None:
    size = 8_000_000  # bytes
    publisher = node.create_publisher(String, 'a', 1)
    used = []
    for _ in range(12):
        received: list[String] = []
        subscription = node.create_subscription(String, 'a', received.append, 1)
        until(lambda: publisher.get_subscription_count() == 1)
        publisher.publish(String(data='s' * size))
        until(lambda received=received: received)
        node.destroy_subscription(subscription)
        until(lambda: publisher.get_subscription_count() == 0)
        used.append(int(Path('/proc/self/statm').read_bytes().split()[1]) * getpagesize())

    assert used[-1] - used[1] < 5 * size


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


def test_a_service_is_called_from_a_callback_of_another_group(node: Node, until: Until) -> None:
    def serve(
        request: ListParameters.Request, response: ListParameters.Response
    ) -> ListParameters.Response:
        response.result.names = request.prefixes
        return response

    node.create_service(ListParameters, 'serve', serve)
    client = node.create_client(ListParameters, 'serve')
    answers = []

    def ask() -> None:
        timer.cancel()
        client.wait_for_service(DEADLINE)
        answers.append(client.call(ListParameters.Request(prefixes=['a']), DEADLINE))

    timer = node.create_timer(0.001, ask, callback_group=MutuallyExclusiveCallbackGroup())

    until(lambda: answers)

    assert answers[0].result.names == ['a']


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


def test_a_guard_condition_is_not_forgotten_while_its_group_is_claimed(
    node: Node, executor: QuickExecutor, until: Until
) -> None:
    group = MutuallyExclusiveCallbackGroup()
    other = node.create_timer(1000.0, lambda: None, callback_group=group)
    calls = []
    guard = node.create_guard_condition(lambda: calls.append(1), callback_group=group)
    group.beginning_execution(other)
    guard.trigger()
    for _ in range(3):
        executor.spin_once(timeout_sec=0)
    assert calls == []

    group.ending_execution(other)
    until(lambda: calls)


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


class GrowingWaitable(Waitable):
    """Waits for timers; there is another one whenever the newest has been ready."""

    def __init__(self, node: Node) -> None:
        super().__init__(node.default_callback_group)
        self.taken: list[int] = []
        self._node = node
        self._timers: list[Timer] = []
        self._indices: list[int] = []
        self._grow()

    def _grow(self) -> None:
        clock, context = self._node.get_clock(), self._node.context
        self._timers.append(Timer(None, None, 1_000_000, clock, context=context))

    def __enter__(self) -> None:
        """Do nothing, as the timers are kept."""

    def __exit__(self, *_: object) -> None:
        """Do nothing."""

    def get_num_entities(self) -> NumberOfEntities:
        """Count the timers."""
        return NumberOfEntities(num_timers=len(self._timers))

    def add_to_wait_set(self, wait_set: WaitSet) -> None:
        """Add the timers."""
        self._indices = [wait_set.add_timer(each.handle) for each in self._timers]

    def is_ready(self, wait_set: WaitSet) -> bool:
        """Return whether the newest timer is ready."""
        return wait_set.is_ready('timer', self._indices[-1])

    def take_data(self) -> int:
        """Take the timers, and return how many they are."""
        for timer in self._timers:
            timer.handle.call_timer()
        return len(self._timers)

    async def execute(self, taken_data: int) -> None:
        """Grow, without a word to the executor."""
        self.taken.append(taken_data)
        self._grow()


def test_a_waitable_may_grow(node: Node, until: Until) -> None:
    waitable = GrowingWaitable(node)
    node.add_waitable(waitable)

    until(lambda: waitable.taken[:3] == [1, 2, 3])


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


def test_a_handle_destroyed_during_a_wait_is_gone(
    node: Node, executor: QuickExecutor, spinning: threading.Thread
) -> None:
    timer = node.create_timer(1000.0, lambda: None)
    subscription = node.create_subscription(Time, 'a', lambda _: None, 1)

    node.destroy_timer(timer)
    node.destroy_subscription(subscription)
    done = executor.create_task(lambda: None)
    while not done.done() or timer.handle.pointer or subscription.handle.pointer:
        assert spinning.is_alive()


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
    executor.spin_once(timeout_sec=0)
    ros.shutdown()
    executor.spin()  # returns
    assert not ros.ok()
