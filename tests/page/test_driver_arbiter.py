"""One page drives, and never one that has closed."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from barc_sim.page.driver_arbiter import IDLE, STALE, DriverArbiter
from barc_sim.page.protocol import Drive

AHEAD = Drive(1.0, 0.0)
LEFT = Drive(0.0, 1.0)
REST = Drive()
BRAKE = Drive(brake=1.0)


@pytest.fixture
def arbiter() -> DriverArbiter:
    return DriverArbiter()


def test_nothing_is_due_until_a_page_presses_a_key(arbiter: DriverArbiter) -> None:
    assert arbiter.request('a', REST, 0.0)
    assert arbiter.due(0.0) is None
    assert arbiter.driver is None


def test_held_key_is_due_at_once_and_every_50_ms(arbiter: DriverArbiter) -> None:
    assert arbiter.request('a', AHEAD, 10.0)
    assert arbiter.due(10.0) == AHEAD
    assert arbiter.due(10.04) is None
    assert arbiter.due(10.05) == AHEAD


def test_a_change_is_due_before_the_50_ms_are_over(arbiter: DriverArbiter) -> None:
    arbiter.request('a', AHEAD, 0.0)
    arbiter.due(0.0)
    arbiter.request('a', LEFT, 0.02)
    assert arbiter.due(0.02) == LEFT


def test_changes_are_due_every_10_ms_at_most(arbiter: DriverArbiter) -> None:
    arbiter.request('a', AHEAD, 0.0)
    arbiter.due(0.0)
    arbiter.request('a', LEFT, 0.001)
    assert arbiter.due(0.001) is None
    assert arbiter.due(0.01) == LEFT


def test_release_is_due_at_once_and_only_once(arbiter: DriverArbiter) -> None:
    arbiter.request('a', AHEAD, 0.0)
    arbiter.due(0.0)
    arbiter.request('a', REST, 0.001)
    assert arbiter.due(0.001) == REST
    assert arbiter.due(1.0) is None


def test_page_that_closes_with_a_key_held_brakes(arbiter: DriverArbiter) -> None:
    arbiter.request('a', AHEAD, 0.0)
    arbiter.due(0.0)
    arbiter.leave('a')
    assert arbiter.due(0.001) == BRAKE
    assert arbiter.due(1.0) is None
    assert arbiter.driver is None


def test_watching_page_changes_nothing_when_it_closes(arbiter: DriverArbiter) -> None:
    arbiter.request('a', AHEAD, 0.0)
    arbiter.leave('b')
    assert arbiter.driver == 'a'
    assert arbiter.due(0.0) == AHEAD


def test_page_that_closes_with_no_key_held_changes_nothing(arbiter: DriverArbiter) -> None:
    arbiter.request('a', AHEAD, 0.0)
    arbiter.request('a', REST, 0.1)
    assert arbiter.due(0.1) is None
    arbiter.leave('a')
    assert arbiter.due(0.2) is None


def test_silent_page_brakes(arbiter: DriverArbiter) -> None:
    arbiter.request('a', AHEAD, 0.0)
    arbiter.due(0.0)
    assert arbiter.due(STALE) == AHEAD
    assert arbiter.due(STALE + 0.001) == BRAKE
    assert arbiter.due(10.0) is None


def test_first_page_drives_and_others_are_refused(arbiter: DriverArbiter) -> None:
    assert arbiter.request('a', AHEAD, 0.0)
    assert not arbiter.request('b', LEFT, 0.1)
    assert arbiter.driver == 'a'
    assert arbiter.due(0.1) == AHEAD


def test_another_page_drives_when_the_driver_has_closed(arbiter: DriverArbiter) -> None:
    arbiter.request('a', AHEAD, 0.0)
    arbiter.leave('a')
    assert arbiter.request('b', LEFT, 0.1)
    assert arbiter.driver == 'b'


def test_another_page_drives_only_after_the_driver_was_idle(arbiter: DriverArbiter) -> None:
    arbiter.request('a', AHEAD, 0.0)
    arbiter.request('a', REST, 1.0)
    arbiter.due(1.0)
    assert not arbiter.request('b', LEFT, 1.0 + IDLE)
    assert arbiter.request('b', LEFT, 1.001 + IDLE)


def test_nobody_drives_after_the_driver_was_idle(arbiter: DriverArbiter) -> None:
    arbiter.request('a', AHEAD, 0.0)
    arbiter.request('a', REST, 1.0)
    arbiter.due(1.0)
    arbiter.due(1.001 + IDLE)
    assert arbiter.driver is None


def test_messages_without_a_key_do_not_keep_the_driver(arbiter: DriverArbiter) -> None:
    arbiter.request('a', AHEAD, 0.0)
    for k in range(100):
        arbiter.request('a', REST, 1.0 + 0.1 * k)
    assert arbiter.request('b', LEFT, 11.0)


@given(
    st.lists(
        st.tuples(
            st.sampled_from('ab'), st.sampled_from([AHEAD, LEFT, REST, None]), st.floats(0.0, 0.2)
        )
    )
)
def test_last_command_of_silent_pages_never_moves_the_car(
    doings: list[tuple[str, Drive | None, float]],
) -> None:
    arbiter = DriverArbiter()
    now, last = 0.0, REST
    for page, command, later in doings:
        now += later
        if command is None:
            arbiter.leave(page)
        else:
            arbiter.request(page, command, now)
        last = arbiter.due(now) or last
    last = arbiter.due(now + STALE + 0.001) or last
    assert last in (REST, BRAKE)
    assert arbiter.due(now + 10.0) is None
