"""Entities of every kind are executed, added, removed and destroyed, as in rclpy.

Their arrivals are counted in descriptors: none is lost, none is left, none is used too early.
"""

# ruff: noqa: SLF001 - rclpy's private names are the point.

from __future__ import annotations

import os
import threading
from contextlib import suppress
from ctypes import c_int32
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from builtin_interfaces.msg import Time
from rcl_interfaces.srv import ListParameters
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.event_handler import (
    EventHandler,
    PublisherEventCallbacks,
    QoSMessageLostInfo,
    QoSSubscriptionEventType,
    SubscriptionEventCallbacks,
)
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

from barc_sim.ros.executor import QuickExecutor, rclpy_private
from barc_sim.ros.executor.rcl import set_listener
from barc_sim.ros.executor.takes import entry_of
from barc_sim.ros.recording.polled import PolledCallbackGroup

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rclpy.context import Context
    from rclpy.subscription import Subscription
    from rclpy.timer import Timer

    Until = Callable[[Callable[[], object]], None]


pytestmark = pytest.mark.timeout(300)
DEADLINE = 100.0


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


class Losses(EventHandler):
    """The event of lost messages, with losses that the test makes up."""

    def __init__(self, node: Node, subscription: Subscription, lost: list[int]) -> None:
        super().__init__(
            callback_group=node.default_callback_group,
            callback=lambda event: lost.append(event.total_count_change),
            event_type=QoSSubscriptionEventType.RCL_SUBSCRIPTION_MESSAGE_LOST,
            parent_impl=subscription.handle,
        )
        self.total = self.change = 2  # before the executor attaches
        self._EventHandler__event = rclpy_private.StandIn(
            self._EventHandler__event, take_event=self._take_status
        )
        node.add_waitable(self)

    def _take_status(self) -> QoSMessageLostInfo:
        counts = {'total_count': self.total, 'total_count_change': self.change}
        self.change = 0
        return type('Status', (QoSMessageLostInfo,), counts)()


def test_lost_messages_are_reported_once(node: Node, executor: QuickExecutor, until: Until) -> None:
    """As Fast DDS does it: a listener resets the change, and the total stays."""
    lost: list[int] = []
    subscription = node.create_subscription(Time, 'a', lambda _: None, 10)
    event = Losses(node, subscription, lost)
    until(lambda: lost)
    assert lost == [2]

    event.total += 3
    entry = executor._events._entries[event]
    executor._events.signal(entry)
    until(lambda: len(lost) == 2)
    executor._events.signal(entry)  # nothing is new
    done = executor.create_task(lambda: 1)
    until(done.done)
    executor.spin_once(timeout_sec=0)
    assert lost == [2, 3]

    node.remove_waitable(event)


def test_an_event_that_waits_is_reported_by_the_next_executor(
    ros: Context, node: Node, executor: QuickExecutor, until: Until
) -> None:
    events = []
    group = MutuallyExclusiveCallbackGroup()
    node.create_publisher(
        Time,
        'a',
        10,
        callback_group=group,
        event_callbacks=PublisherEventCallbacks(matched=events.append),
    )
    busy = node.create_guard_condition(print, callback_group=group)
    executor.spin_once(timeout_sec=0)
    group.beginning_execution(busy)
    node.create_subscription(Time, 'a', lambda _: None, 10)
    for _ in range(3):
        executor.spin_once(timeout_sec=0.01)
    assert events == []

    executor.remove_node(node)
    group.ending_execution(busy)
    with QuickExecutor(2, context=ros) as other:
        other.add_node(node)
        while not events:
            other.spin_once(timeout_sec=1.0)
        other.spin_once(timeout_sec=0)
        other.remove_node(node)
    assert [(event.total_count, event.total_count_change) for event in events] == [(1, 1)]

    executor.add_node(node)
    done = executor.create_task(lambda: 1)
    until(done.done)
    assert len(events) == 1


def test_a_trigger_that_rclpys_executor_has_noted_is_not_lost(
    ros: Context, node: Node, executor: QuickExecutor, until: Until
) -> None:
    called = []
    guard = node.create_guard_condition(lambda: called.append(1))
    executor.remove_node(node)
    with SingleThreadedExecutor(context=ros) as first:
        first.add_node(node)
        guard.trigger()
        handler, entity, _ = first.wait_for_ready_callbacks(timeout_sec=20.0)
        assert entity is guard
        handler.cancel()
        first.remove_node(node)
    executor.add_node(node)
    until(lambda: called)

    assert called == [1]


def test_a_timers_callback_gets_what_rclpys_own_take_gives_it(
    node: Node, executor: QuickExecutor, until: Until, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As from Kilted's rclpy on, where a callback may take a `TimerInfo`."""
    infos = []

    def take_timer(timer: Timer) -> Callable[[], Coroutine[None, None, None]]:
        timer.handle.call_timer()

        async def execute() -> None:
            timer.callback('info')

        return execute

    monkeypatch.setattr('barc_sim.ros.executor.rclpy_private.TIMERS_GIVE_INFO', True)
    monkeypatch.setattr(executor, '_take_timer', take_timer)
    node.create_timer(0.001, infos.append)
    until(lambda: len(infos) >= 2)
    assert infos[:2] == ['info', 'info']


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


def test_nodes_are_added_and_removed_while_spinning(
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


def test_a_removed_node_has_no_more_callbacks(
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


@pytest.mark.usefixtures('spinning')
def test_a_node_moves_between_executors_that_spin(
    ros: Context, node: Node, executor: QuickExecutor
) -> None:
    received, triggered = threading.Semaphore(0), threading.Semaphore(0)
    node.create_subscription(Time, 'a', lambda _: received.release(), 10)
    guard = node.create_guard_condition(triggered.release)
    publisher = node.create_publisher(Time, 'a', 10)
    with QuickExecutor(2, context=ros) as other:
        thread = threading.Thread(target=other.spin)
        thread.start()
        for each in [other, executor] * 50:
            each.add_node(node)  # which takes it from the other one
            publisher.publish(Time())
            guard.trigger()
            assert received.acquire(timeout=DEADLINE)
            assert triggered.acquire(timeout=DEADLINE)
    thread.join(DEADLINE)

    assert not thread.is_alive()


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


def test_a_subscription_with_messages_is_destroyed_at_once(
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


def test_an_entity_destroyed_without_its_node_is_not_executed(
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


def test_a_callback_can_destroy_entities_that_are_ready(node: Node, until: Until) -> None:
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


def test_a_cancelled_timer_is_not_called_until_it_is_reset(node: Node, until: Until) -> None:
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


def test_a_reference_to_trigger_from_before_wakes_the_executor(
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
    [100, pytest.param(10_000, marks=[pytest.mark.slow, pytest.mark.timeout(600)])],
)
def test_a_listener_never_writes_into_another_file(
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


def test_messages_are_received_once_by_a_busy_and_an_idle_executor(
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


def test_one_call_of_a_listener_can_count_several_messages(node: Node) -> None:
    """DDS tells once of all that a reliable reader held back until a lost one came again."""
    subscription = node.create_subscription(
        Time, 'a', lambda _: None, 10, callback_group=PolledCallbackGroup()
    )
    publisher = node.create_publisher(Time, 'a', 10)
    for number in range(3):
        publisher.publish(Time(sec=number))
    counter, entry = c_int32(), entry_of(subscription, 'subscriptions', node)

    set_listener(entry, counter)
    set_listener(entry, None)

    assert counter.value == 3


def test_a_time_before_1970_is_dropped_with_a_warning(
    make_node: Callable[..., Node], until: Until, capfd: pytest.CaptureFixture[str]
) -> None:
    node = make_node(parameter_overrides=[Parameter('use_sim_time', value=True)])
    publisher = node.create_publisher(Clock, '/clock', 10)

    publisher.publish(Clock(clock=Time(sec=-1)))
    until(lambda: 'dropped' in capfd.readouterr().err)
    publisher.publish(Clock(clock=Time(sec=7)))
    until(lambda: node.get_clock().now().nanoseconds == 7 * 10**9)


def test_an_unreadable_message_is_dropped_with_a_warning(
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
        until(lambda: len(floods) > 200 and len(set(floods)) > 10)
    finally:
        ended.set()
        thread.join()
