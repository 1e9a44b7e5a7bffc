"""A time budget for calls."""

from __future__ import annotations

import gc
import threading
import time

import pytest

from barc_sim.lab.user_code.calls import Budget, OutOfTime


def forever() -> None:
    while True:
        pass


def test_a_call_within_its_time_returns_and_raises_as_without() -> None:
    budget = Budget(10.0)
    assert budget.call(divmod, 7, 2) == (3, 1)
    with pytest.raises(ZeroDivisionError):
        budget.call(divmod, 1, 0)


def test_a_call_is_ended_in_whichever_thread_it_is_made() -> None:
    ended = []

    def make() -> None:
        try:
            Budget(0.1).call(forever)
        except OutOfTime:
            ended.append(threading.current_thread())

    thread = threading.Thread(target=make)
    thread.start()
    thread.join(20.0)
    assert ended == [thread]


def test_many_short_calls_are_not_one_long() -> None:
    budget = Budget(0.1)
    end = time.monotonic() + 0.4
    while time.monotonic() < end:
        budget.call(divmod, 1, 1)


def test_a_budget_serves_again_after_a_call_was_ended() -> None:
    budget = Budget(0.1)
    for _ in range(3):
        with pytest.raises(OutOfTime):
            budget.call(forever)
    assert budget.call(divmod, 7, 2) == (3, 1)


def test_nothing_strikes_after_a_call_that_ended_just_in_time() -> None:
    budget = Budget(0.05)

    def until(end: float) -> None:
        while time.monotonic() < end:
            pass

    # Around the time at which calls are ended.
    for extra in range(30):
        try:
            budget.call(until, time.monotonic() + 0.09 + extra * 0.0005)
        except OutOfTime:
            continue
        for _ in range(1000):
            pass


def test_the_thread_ends_with_its_budget() -> None:
    budget = Budget(1.0)
    thread = next(t for t in reversed(threading.enumerate()) if t.name == 'time budget')
    del budget
    gc.collect()
    thread.join(20.0)
    assert not thread.is_alive()
