"""The loop of a run without ROS."""

from __future__ import annotations

from threading import Thread
from typing import TYPE_CHECKING

from barc_sim.runs.local.loop import Loop

if TYPE_CHECKING:
    import pytest


def test_callbacks_run_in_order_and_those_they_add_later() -> None:
    loop, seen = Loop(), []

    def first() -> None:
        seen.append(1)
        loop.soon(lambda: seen.append(3))

    loop.soon(first)
    loop.soon(lambda: seen.append(2))
    loop.run(lambda: len(seen) == 3)
    assert seen == [1, 2, 3]


def test_another_thread_wakes_the_loop() -> None:
    loop, seen = Loop(), []
    thread = Thread(target=lambda: loop.call(lambda: seen.append(1)))
    thread.start()
    loop.run(lambda: bool(seen))  # without timers it would wait for ever
    thread.join()


def test_a_call_is_not_held_up_by_endless_callbacks() -> None:
    loop, seen = Loop(), []

    def again() -> None:
        loop.soon(again)

    again()
    loop.call(lambda: seen.append(1))
    loop.run(lambda: bool(seen))


def test_timer_leaves_out_periods_that_have_passed(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr('barc_sim.runs.local.loop.time.monotonic', lambda: now[0])
    loop, fired = Loop(), []
    timer = loop.timer(1.0, lambda: fired.append(now[0]))
    timer.reset()
    now[0] = 103.5
    loop.run(lambda: bool(fired))
    assert (fired, timer.due) == ([103.5], 104.0)
    timer.cancel()
    assert timer.due == float('inf')
