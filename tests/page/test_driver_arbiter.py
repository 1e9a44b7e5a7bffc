"""One page drives, and none that has gone."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from barc_sim.page.driver_arbiter import IDLE, STALE, Wheel
from barc_sim.page.protocol import Drive

AHEAD = Drive(1.0, 0.0)
LEFT = Drive(0.0, 1.0)
REST = Drive()
BRAKE = Drive(brake=1.0)


@pytest.fixture
def wheel() -> Wheel:
    return Wheel()


def test_is_silent_until_a_page_presses(wheel: Wheel) -> None:
    assert wheel.turn('a', REST, 0.0)
    assert wheel.due(0.0) is None
    assert wheel.driver is None


def test_what_is_held_is_due_at_once_and_every_50_ms(wheel: Wheel) -> None:
    assert wheel.turn('a', AHEAD, 10.0)
    assert wheel.due(10.0) == AHEAD
    assert wheel.due(10.04) is None
    assert wheel.due(10.05) == AHEAD


def test_a_change_is_due_before_the_50_ms_are_over(wheel: Wheel) -> None:
    wheel.turn('a', AHEAD, 0.0)
    wheel.due(0.0)
    wheel.turn('a', LEFT, 0.02)
    assert wheel.due(0.02) == LEFT


def test_changes_are_due_every_10_ms_at_most(wheel: Wheel) -> None:
    wheel.turn('a', AHEAD, 0.0)
    wheel.due(0.0)
    wheel.turn('a', LEFT, 0.001)
    assert wheel.due(0.001) is None
    assert wheel.due(0.01) == LEFT


def test_release_is_due_at_once_and_only_once(wheel: Wheel) -> None:
    wheel.turn('a', AHEAD, 0.0)
    wheel.due(0.0)
    wheel.turn('a', REST, 0.001)
    assert wheel.due(0.001) == REST
    assert wheel.due(1.0) is None


def test_a_page_that_leaves_with_a_key_held_brakes(wheel: Wheel) -> None:
    wheel.turn('a', AHEAD, 0.0)
    wheel.due(0.0)
    wheel.leave('a')
    assert wheel.due(0.001) == BRAKE
    assert wheel.due(1.0) is None
    assert wheel.driver is None


def test_a_page_that_watches_may_leave(wheel: Wheel) -> None:
    wheel.turn('a', AHEAD, 0.0)
    wheel.leave('b')
    assert wheel.driver == 'a'
    assert wheel.due(0.0) == AHEAD


def test_a_page_that_leaves_with_nothing_held_changes_nothing(wheel: Wheel) -> None:
    wheel.turn('a', AHEAD, 0.0)
    wheel.turn('a', REST, 0.1)
    assert wheel.due(0.1) is None
    wheel.leave('a')
    assert wheel.due(0.2) is None


def test_a_page_that_says_nothing_any_more_brakes(wheel: Wheel) -> None:
    wheel.turn('a', AHEAD, 0.0)
    wheel.due(0.0)
    assert wheel.due(STALE) == AHEAD
    assert wheel.due(STALE + 0.001) == BRAKE
    assert wheel.due(10.0) is None


def test_the_first_that_presses_drives_and_others_are_refused(wheel: Wheel) -> None:
    assert wheel.turn('a', AHEAD, 0.0)
    assert not wheel.turn('b', LEFT, 0.1)
    assert wheel.driver == 'a'
    assert wheel.due(0.1) == AHEAD


def test_another_drives_when_the_driver_has_left(wheel: Wheel) -> None:
    wheel.turn('a', AHEAD, 0.0)
    wheel.leave('a')
    assert wheel.turn('b', LEFT, 0.1)
    assert wheel.driver == 'b'


def test_another_drives_only_when_the_driver_has_been_idle(wheel: Wheel) -> None:
    wheel.turn('a', AHEAD, 0.0)
    wheel.turn('a', REST, 1.0)
    wheel.due(1.0)
    assert not wheel.turn('b', LEFT, 1.0 + IDLE)
    assert wheel.turn('b', LEFT, 1.001 + IDLE)


def test_the_wheel_is_free_when_the_driver_has_been_idle(wheel: Wheel) -> None:
    wheel.turn('a', AHEAD, 0.0)
    wheel.turn('a', REST, 1.0)
    wheel.due(1.0)
    wheel.due(1.001 + IDLE)
    assert wheel.driver is None


def test_a_driver_that_holds_nothing_does_not_keep_the_wheel_by_saying_so(wheel: Wheel) -> None:
    wheel.turn('a', AHEAD, 0.0)
    for k in range(100):
        wheel.turn('a', REST, 1.0 + 0.1 * k)
    assert wheel.turn('b', LEFT, 11.0)


@given(
    st.lists(
        st.tuples(
            st.sampled_from('ab'), st.sampled_from([AHEAD, LEFT, REST, None]), st.floats(0.0, 0.2)
        )
    )
)
def test_whatever_pages_do_the_last_command_moves_nothing_once_they_are_silent(
    doings: list[tuple[str, Drive | None, float]],
) -> None:
    wheel = Wheel()
    now, last = 0.0, REST
    for page, command, later in doings:
        now += later
        if command is None:
            wheel.leave(page)
        else:
            wheel.turn(page, command, now)
        last = wheel.due(now) or last
    last = wheel.due(now + STALE + 0.001) or last
    assert last in (REST, BRAKE)
    assert wheel.due(now + 10.0) is None
