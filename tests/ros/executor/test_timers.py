"""Timers are called, cancelled, reset and changed as in rclpy, and follow simulated time."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import pytest
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

    from barc_sim.ros.executor import QuickExecutor

    Until = Callable[[Callable[[], object]], None]

pytestmark = pytest.mark.timeout(60)


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


def test_timers_cancelled_and_reset_by_another_thread_never_end_the_spin(
    node: Node, until: Until
) -> None:
    calls = []
    timer = node.create_timer(
        1e-6, lambda: calls.append(1), callback_group=MutuallyExclusiveCallbackGroup()
    )
    enough = threading.Event()

    def disturb() -> None:
        while not enough.is_set():
            timer.cancel()
            timer.reset()

    thread = threading.Thread(target=disturb)
    thread.start()
    try:
        until(lambda: len(calls) > 200)
    finally:
        enough.set()
        thread.join()


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
