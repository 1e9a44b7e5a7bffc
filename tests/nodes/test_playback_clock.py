"""The bag's time during a playback passes, stands still and jumps as keys ask for."""

from __future__ import annotations

from threading import Event, Thread
from typing import Any

import pytest

from barc_sim.nodes.playback_clock import PlaybackClock

SECOND = 10**9
DEADLINE = 60.0  #: [s] on a busy machine


def clock(
    *,
    rate: float = 1.0,
    is_paused: bool = False,
    **options: Any,  # noqa: ANN401
) -> PlaybackClock:
    pause = {'pause_period': None, 'on_pause': lambda: None} | options
    return PlaybackClock(SECOND, rate=rate, is_paused=is_paused, **pause)


def test_a_message_in_the_past_is_due_at_once() -> None:
    assert clock().wait_until(0)


def test_time_passes_at_the_rate_until_a_message_is_due() -> None:
    fast = clock(rate=1000.0)
    assert fast.wait_until(11 * SECOND)
    assert fast.now >= 11 * SECOND


def test_quit_ends_the_wait() -> None:
    playback = clock()
    playback.press('quit')
    assert not playback.wait_until(10_000 * SECOND)


def test_a_step_while_paused_goes_to_the_next_message_and_stays_there() -> None:
    paused = clock(is_paused=True)
    paused.press('right')
    assert paused.wait_until(5 * SECOND)
    assert paused.now == 5 * SECOND
    paused.press('quit')
    assert not paused.wait_until(6 * SECOND)
    assert paused.now == 5 * SECOND


def test_a_step_passes_the_times_of_the_clock_on_its_way_to_a_message() -> None:
    paused = clock(is_paused=True, pause_period=0.001)
    paused.press('right')
    assert paused.wait_until(2 * SECOND, is_message=False)
    assert paused.wait_until(3 * SECOND)
    paused.press('quit')
    assert not paused.wait_until(4 * SECOND)


def test_a_step_has_no_effect_while_time_passes() -> None:
    playback = clock(rate=1000.0)
    playback.press('right')
    playback.press('space')
    playback.press('quit')
    assert not playback.wait_until(10_000 * SECOND)
    assert playback.is_paused


def test_a_resumed_playback_continues_where_it_was_paused() -> None:
    paused = clock(rate=1000.0, is_paused=True)
    paused.press('space')
    assert paused.wait_until(2 * SECOND)
    assert not paused.is_paused
    assert paused.now >= 2 * SECOND


def test_a_pause_is_announced_once_a_period() -> None:
    announced = Event()
    paused = clock(is_paused=True, pause_period=0.001, on_pause=announced.set)
    thread = Thread(target=paused.wait_until, args=(5 * SECOND,))
    thread.start()
    for _ in range(2):
        assert announced.wait(DEADLINE)
        announced.clear()
    paused.press('quit')
    thread.join(DEADLINE)

    assert not thread.is_alive()


@pytest.mark.parametrize('is_paused', [True, False])
def test_the_time_can_be_set_during_a_pause_and_a_playback(is_paused: bool) -> None:
    playback = clock(is_paused=is_paused)
    playback.set(100 * SECOND)
    assert playback.now >= 100 * SECOND
