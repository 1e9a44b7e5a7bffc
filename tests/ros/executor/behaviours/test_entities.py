"""Topics, timers, rates, guard conditions, waitables and callback groups."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

import pytest
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.clock import ROSClock
from rclpy.guard_condition import GuardCondition
from rclpy.parameter import Parameter
from rclpy.task import Future
from rclpy.waitable import NumberOfEntities, Waitable
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Int32

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context
    from rclpy.executors import Executor
    from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
    from rclpy.node import Node

    Until = Callable[[Callable[[], object]], None]

pytestmark = pytest.mark.timeout(60)
DEADLINE = 20.0


def test_messages_are_received_once_and_in_order(node: Node, until: Until) -> None:
    received: list[int] = []
    publisher = node.create_publisher(Int32, 'number', 100)
    node.create_subscription(Int32, 'number', lambda message: received.append(message.data), 100)
    until(publisher.get_subscription_count)
    for number in range(30):
        publisher.publish(Int32(data=number))
    until(lambda: len(received) >= 30)
    assert received == list(range(30))


def test_a_subscription_receives_information_or_raw_data(node: Node, until: Until) -> None:
    received: dict[str, Any] = {}

    def with_info(message: Int32, info: dict[str, int]) -> None:
        received['info'] = (message.data, info['source_timestamp'])

    node.create_subscription(Int32, 'number', with_info, 10)
    node.create_subscription(
        Int32, 'number', lambda data: received.setdefault('raw', data), 10, raw=True
    )
    publisher = node.create_publisher(Int32, 'number', 10)
    until(lambda: publisher.get_subscription_count() == 2)
    publisher.publish(Int32(data=7))
    until(lambda: len(received) == 2)

    assert received['info'][0] == 7
    assert received['info'][1] > 0
    assert isinstance(received['raw'], bytes)


def test_a_destroyed_entity_is_not_executed(
    node: Node, until: Until, spin_for: Callable[[float], None]
) -> None:
    received: list[int] = []
    publisher = node.create_publisher(Int32, 'number', 10)
    subscription = node.create_subscription(Int32, 'number', received.append, 10)
    timer = node.create_timer(0.001, lambda: received.append(1))
    until(lambda: publisher.get_subscription_count() and received)
    publisher.publish(Int32())
    node.destroy_subscription(subscription)
    node.destroy_timer(timer)
    received.clear()
    spin_for(0.02)

    assert received == []


def test_a_timer_is_called_each_period(node: Node, until: Until) -> None:
    called = []
    begin = time.monotonic()
    node.create_timer(0.01, lambda: called.append(time.monotonic() - begin))
    until(lambda: len(called) >= 4)
    assert all(at >= 0.01 * number - 1e-3 for number, at in enumerate(called[:4], 1))


def test_a_cancelled_timer_is_not_called_until_it_is_reset(
    node: Node, until: Until, spin_for: Callable[[float], None]
) -> None:
    called = []

    def call() -> None:
        called.append(1)
        timer.cancel()

    timer = node.create_timer(0.002, call)
    until(lambda: called)
    spin_for(0.02)
    assert called == [1]
    assert timer.is_canceled()

    timer.reset()
    until(lambda: len(called) == 2)
    assert not timer.is_ready()


def test_a_timer_that_is_not_started_is_not_called(
    node: Node, until: Until, spin_for: Callable[[float], None]
) -> None:
    called = []
    timer = node.create_timer(0.001, lambda: called.append(1), autostart=False)
    spin_for(0.02)
    assert called == []
    timer.reset()
    until(lambda: called)


def test_a_reset_puts_a_timer_off(node: Node, spin_for: Callable[[float], None]) -> None:
    called = []
    slow = node.create_timer(3600.0, lambda: called.append(1))
    node.create_timer(0.001, slow.reset)
    spin_for(0.02)
    assert called == []
    assert 0 < slow.time_until_next_call() <= 3600 * 10**9


def test_a_period_can_be_changed(node: Node, until: Until) -> None:
    called = []
    timer = node.create_timer(3600.0, lambda: called.append(1))
    timer.timer_period_ns = 1_000_000
    timer.reset()
    until(lambda: len(called) >= 2)


def test_a_timer_with_the_period_0_is_called_again_and_again(node: Node, until: Until) -> None:
    called = []
    node.create_timer(0.0, lambda: called.append(1))
    until(lambda: len(called) >= 5)


def test_a_timer_follows_simulated_time(
    node: Node, until: Until, spin_for: Callable[[float], None]
) -> None:
    node.set_parameters([Parameter('use_sim_time', value=True)])
    clock = node.get_clock()
    assert isinstance(clock, ROSClock)
    times: list[float] = []
    node.create_timer(1.0, lambda: times.append(clock.now().nanoseconds / 1e9))
    publisher = node.create_publisher(Clock, '/clock', 10)

    def set_time(seconds: int) -> None:
        message = Clock()
        message.clock.sec = seconds
        publisher.publish(message)
        until(lambda: clock.now().nanoseconds == seconds * 10**9)

    until(publisher.get_subscription_count)
    set_time(1000)
    until(lambda: times)  # from no time to a time is a jump forwards
    times.clear()
    spin_for(0.02)
    assert times == []
    set_time(1001)
    until(lambda: times)
    assert times == [1001.0]


def test_timers_of_several_nodes_are_all_called(
    make_node: Callable[[], Node], until: Until
) -> None:
    called: dict[int, int] = dict.fromkeys(range(3), 0)

    def count(number: int) -> None:
        called[number] += 1

    for number in called:
        make_node().create_timer(0.002, lambda number=number: count(number))
    until(lambda: min(called.values()) >= 3)


def test_a_rate_paces_a_thread(executor: Executor, node: Node) -> None:
    rate = node.create_rate(100.0)
    slept = []

    def sleep() -> None:
        for _ in range(3):
            rate.sleep()
            slept.append(1)
        done.set_result(1)

    done = Future(executor=executor)
    thread = threading.Thread(target=sleep)
    thread.start()
    executor.spin_until_future_complete(done, DEADLINE)
    thread.join(DEADLINE)
    node.destroy_rate(rate)
    assert len(slept) == 3


def test_a_rate_paces_a_callback_of_another_group(
    executor: Executor, node: Node, deadline: float
) -> None:
    rate = node.create_rate(100.0)
    done = Future(executor=executor)

    def work() -> None:
        if rate._timer.handle:  # noqa: SLF001 - rclpy has no other way to ask
            rate.sleep()
        done.set_result(1)

    if deadline < DEADLINE:
        pytest.xfail('one thread: the callback would never return')
    guard = node.create_guard_condition(work, callback_group=MutuallyExclusiveCallbackGroup())
    guard.trigger()
    executor.spin_until_future_complete(done, deadline)
    assert done.done()


def test_a_guard_condition_is_called_for_each_trigger(node: Node, until: Until) -> None:
    called = []
    guard = node.create_guard_condition(lambda: called.append(1))
    for count in range(1, 4):
        guard.trigger()
        until(lambda count=count: len(called) >= count)
    assert len(called) == 3


def test_a_guard_condition_is_called_once_for_triggers_before(
    executor: Executor, node: Node, until: Until, spin_for: Callable[[float], None]
) -> None:
    del executor
    called = []
    guard = node.create_guard_condition(lambda: called.append(1))
    guard.trigger()
    guard.trigger()
    until(lambda: called)
    spin_for(0.02)
    assert called == [1]


def test_a_callback_triggers_its_own_guard_condition(node: Node, until: Until) -> None:
    called = []

    def call() -> None:
        called.append(1)
        if len(called) < 3:
            guard.trigger()

    guard = node.create_guard_condition(call)
    guard.trigger()
    until(lambda: len(called) >= 3)


class Doorbell(Waitable):
    """A waitable of the user's own, on a guard condition."""

    def __init__(self, node: Node) -> None:
        super().__init__(ReentrantCallbackGroup())
        self.guard = GuardCondition(None, None, context=node.context)
        self.taken = 0
        self.executed: list[int] = []
        self._index = 0
        self._is_ready = False
        self.answer = Future()
        self.add_future(self.answer)
        node.add_waitable(self)

    def __enter__(self) -> None:
        """Use the handle."""
        self.guard.handle.__enter__()

    def __exit__(self, *error: object) -> None:
        """Use it no longer."""
        self.guard.handle.__exit__(*error)

    def get_num_entities(self) -> NumberOfEntities:
        """Wait for one guard condition."""
        return NumberOfEntities(num_gcs=1)

    def add_to_wait_set(self, wait_set: _rclpy.WaitSet) -> None:
        """Wait for the guard condition."""
        self._index = wait_set.add_guard_condition(self.guard.handle)

    def is_ready(self, wait_set: _rclpy.WaitSet) -> bool:
        """Return whether it was triggered."""
        self._is_ready = self._is_ready or wait_set.is_ready('guard_condition', self._index)
        return self._is_ready

    def take_data(self) -> int | None:
        """Take the trigger."""
        if not self._is_ready:
            return None
        self._is_ready = False
        self.taken += 1
        return self.taken

    async def execute(self, taken_data: int | None) -> None:
        """Note it, and complete the future."""
        if taken_data is not None:
            self.executed.append(taken_data)
            if not self.answer.done():
                self.answer.set_result(taken_data)


def test_a_waitable_is_executed_with_what_it_took(
    executor: Executor, node: Node, until: Until
) -> None:
    bell = Doorbell(node)
    called: list[Future] = []
    bell.answer.add_done_callback(called.append)
    for count in range(1, 4):
        bell.guard.trigger()
        until(lambda count=count: len(bell.executed) >= count)
    until(lambda: called)
    node.remove_waitable(bell)
    executor.spin_once(timeout_sec=0)
    bell.guard.destroy()

    assert bell.executed == [1, 2, 3]
    assert called == [bell.answer]


class Overlap:
    """Counts how many of its calls run at the same time."""

    def __init__(self, expected: int, patience: float) -> None:
        self.calls = 0
        self.maximum = 0
        self._running = 0
        self._lock = threading.Lock()
        self._met = threading.Event()
        self._expected = expected
        self._patience = patience

    def __call__(self, *_: object) -> None:
        """Wait until as many calls as expected run, or for a moment."""
        with self._lock:
            self._running += 1
            self.calls += 1
            self.maximum = max(self.maximum, self._running)
            if self._running >= self._expected:
                self._met.set()
        self._met.wait(self._patience)
        with self._lock:
            self._running -= 1


def test_callbacks_of_an_exclusive_group_never_overlap(node: Node, until: Until) -> None:
    overlap = Overlap(expected=2, patience=0.01)
    group = MutuallyExclusiveCallbackGroup()
    for _ in range(3):
        node.create_timer(0.001, overlap, callback_group=group)
        node.create_guard_condition(overlap, callback_group=group).trigger()
    until(lambda: overlap.calls >= 6)
    assert overlap.maximum == 1


def test_reentrant_callbacks_overlap(node: Node, until: Until, deadline: float) -> None:
    overlap = Overlap(expected=2, patience=deadline / 5)
    group = ReentrantCallbackGroup()
    for _ in range(2):
        node.create_guard_condition(overlap, callback_group=group).trigger()
    until(lambda: overlap.calls >= 2)
    assert overlap.maximum == 2


def test_a_callback_that_blocks_does_not_stop_other_groups(
    executor: Executor, node: Node, deadline: float
) -> None:
    released = threading.Event()
    done = Future(executor=executor)

    def block() -> None:
        if released.wait(deadline):
            done.set_result(1)

    node.create_guard_condition(block, callback_group=MutuallyExclusiveCallbackGroup()).trigger()
    node.create_timer(0.02, released.set, callback_group=MutuallyExclusiveCallbackGroup())
    executor.spin_until_future_complete(done, deadline)
    assert done.done()


def test_an_exclusive_group_is_free_after_its_callback(
    node: Node, until: Until, context: Context
) -> None:
    assert context.ok()

    group = MutuallyExclusiveCallbackGroup()
    states: list[bool] = []
    guard = node.create_guard_condition(
        lambda: states.append(group.can_execute(guard)), callback_group=group
    )
    guard.trigger()
    until(lambda: states)
    until(lambda: group.can_execute(guard))
    assert states[0] is False
