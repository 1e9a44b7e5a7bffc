"""The bag's time during a playback passes, stands still and jumps as its controls ask for."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from math import inf
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

import pytest

from barc_sim.nodes.playback_clock import PlaybackClock, Wake

if TYPE_CHECKING:
    from collections.abc import Iterator

SECOND = 10**9
FAR = 10_000 * SECOND
DEADLINE = 60.0  #: [s] on a busy machine


def clock(
    *,
    rate: float = 1.0,
    is_paused: bool = False,
    **options: Any,  # noqa: ANN401
) -> PlaybackClock:
    pause = {'pause_period': None, 'on_pause': lambda: None} | options
    return PlaybackClock(SECOND, rate=rate, is_paused=is_paused, **pause)


@pytest.fixture
def thread() -> Iterator[ThreadPoolExecutor]:
    """Return a thread: it plays, or controls what the test plays."""
    with ThreadPoolExecutor(1) as pool:
        yield pool


def test_a_message_in_the_past_is_due_at_once() -> None:
    assert clock().wait_until(0) is Wake.DUE


def test_time_passes_at_the_rate_until_a_message_is_due() -> None:
    fast = clock(rate=1000.0)
    assert fast.wait_until(11 * SECOND) is Wake.DUE
    assert fast.now >= 11 * SECOND


def test_a_stop_ends_every_wait() -> None:
    playback = clock()
    playback.stop()
    assert playback.wait_until(FAR) is Wake.STOPPED
    assert playback.delay(DEADLINE) is Wake.STOPPED
    assert playback.wait_at_end() is Wake.STOPPED
    assert not playback.seek(5 * SECOND)


def test_a_step_while_paused_goes_to_the_next_message_and_stays_there() -> None:
    paused = clock(is_paused=True)
    paused.add_step()
    assert paused.wait_until(5 * SECOND) is Wake.DUE
    assert paused.now == 5 * SECOND
    paused.stop()
    assert paused.wait_until(6 * SECOND) is Wake.STOPPED
    assert paused.now == 5 * SECOND


def test_a_step_passes_the_times_of_the_clock_on_its_way_to_a_message() -> None:
    paused = clock(is_paused=True, pause_period=0.001)
    paused.add_step()
    assert paused.wait_until(2 * SECOND, is_message=False) is Wake.DUE
    assert paused.wait_until(3 * SECOND) is Wake.DUE
    paused.stop()
    assert paused.wait_until(4 * SECOND) is Wake.STOPPED


def test_steps_are_counted_when_their_messages_have_been_published(
    thread: ThreadPoolExecutor,
) -> None:
    paused = clock(is_paused=True)
    steps = thread.submit(paused.step, 2)
    assert paused.wait_until(2 * SECOND) is Wake.DUE
    assert paused.wait_until(3 * SECOND) is Wake.DUE
    assert not steps.done()
    waiting = Thread(target=paused.wait_until, args=(4 * SECOND,))
    waiting.start()
    assert steps.result(DEADLINE) == 2
    paused.stop()
    waiting.join(DEADLINE)


@pytest.mark.parametrize('count', [5, inf])
def test_steps_end_with_the_bag(thread: ThreadPoolExecutor, count: float) -> None:
    paused = clock(is_paused=True)
    steps = thread.submit(paused.step, count)
    assert paused.wait_until(2 * SECOND) is Wake.DUE
    end = Thread(target=paused.wait_at_end)
    end.start()
    assert steps.result(DEADLINE) == 1
    assert paused.step() == 0
    paused.stop()
    end.join(DEADLINE)
    assert not end.is_alive()


def test_a_step_counts_only_while_paused() -> None:
    playback = clock()
    playback.add_step()
    assert playback.step(inf) == 0
    playback.toggle_pause()
    playback.stop()
    assert playback.wait_until(FAR) is Wake.STOPPED
    assert playback.is_paused


def test_a_resumed_playback_continues_from_where_it_was_paused() -> None:
    paused = clock(rate=1000.0, is_paused=True)
    paused.resume()
    assert paused.wait_until(2 * SECOND) is Wake.DUE
    assert not paused.is_paused
    assert paused.now >= 2 * SECOND


def test_a_pause_ends_a_running_wait_for_a_message(thread: ThreadPoolExecutor) -> None:
    playback = clock()
    wait = thread.submit(playback.wait_until, FAR)
    playback.pause()
    position = playback.now
    playback.add_step()
    assert wait.result(DEADLINE) is Wake.DUE
    assert position < playback.now == FAR


def test_a_new_rate_counts_from_now_on(thread: ThreadPoolExecutor) -> None:
    playback = clock(rate=0.001)
    wait = thread.submit(playback.wait_until, 1000 * SECOND)
    playback.set_rate(1e6)
    assert wait.result(DEADLINE) is Wake.DUE
    assert playback.rate == 1e6
    assert playback.now >= 1000 * SECOND


@pytest.mark.parametrize('is_paused', [True, False])
def test_a_jump_ends_a_wait_until_the_playback_takes_it(
    thread: ThreadPoolExecutor, is_paused: bool
) -> None:
    playback = clock(is_paused=is_paused)
    jump = thread.submit(playback.seek, 100 * SECOND)
    assert playback.wait_until(FAR) is Wake.SOUGHT
    assert not jump.done()
    assert playback.take_sought() == 100 * SECOND
    assert jump.result(DEADLINE)
    assert playback.now >= 100 * SECOND
    playback.stop()
    assert playback.wait_until(FAR) is Wake.STOPPED


def test_the_time_stands_still_during_a_delay(thread: ThreadPoolExecutor) -> None:
    announced = Event()
    playback = clock(pause_period=0.001, on_pause=announced.set)
    delay = thread.submit(playback.delay, DEADLINE)
    assert announced.wait(DEADLINE)
    assert playback.now == SECOND
    jump = Thread(target=playback.seek, args=(5 * SECOND,))
    jump.start()
    assert delay.result(DEADLINE) is Wake.SOUGHT
    assert playback.take_sought() == 5 * SECOND
    jump.join(DEADLINE)
    assert playback.delay(0.001) is Wake.DUE


def test_a_pause_is_announced_again_and_again() -> None:
    announced = Event()
    paused = clock(is_paused=True, pause_period=0.001, on_pause=announced.set)
    thread = Thread(target=paused.wait_until, args=(5 * SECOND,))
    thread.start()
    for _ in range(2):
        assert announced.wait(DEADLINE)
        announced.clear()
    paused.stop()
    thread.join(DEADLINE)

    assert not thread.is_alive()


@pytest.mark.parametrize('is_paused', [True, False])
def test_time_can_be_set(is_paused: bool) -> None:
    playback = clock(is_paused=is_paused)
    playback.set(100 * SECOND)
    assert playback.now >= 100 * SECOND
