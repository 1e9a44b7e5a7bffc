"""One page drives, and never one that has closed."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from barc_sim.page.protocol import Drive
from barc_sim.page.run_page import IDLE, STALE, DriverArbiter

AHEAD = Drive(1.0, 0.0)
LEFT = Drive(0.0, 1.0)
REST = Drive()
BRAKE = Drive(brake=1.0)


#: By name, what happens and what is due: (page, command, [s]), (page, 'refused', [s]) for one
#: whose command is not taken, (page, 'closes', [s]), ('due', command, [s]), ('driver', page, [s]).
CASES: dict[str, list[tuple[str, Drive | str | None, float]]] = {
    'nothing is due until a page presses a key': [
        ('a', REST, 0.0), ('due', None, 0.0), ('driver', None, 0.0),
    ],
    'a held key is due at once and every 50 ms': [
        ('a', AHEAD, 10.0), ('due', AHEAD, 10.0), ('due', None, 10.04), ('due', AHEAD, 10.05),
    ],
    'a change is due before the 50 ms are over': [
        ('a', AHEAD, 0.0), ('due', AHEAD, 0.0), ('a', LEFT, 0.02), ('due', LEFT, 0.02),
    ],
    'changes are due every 10 ms at most': [
        ('a', AHEAD, 0.0), ('due', AHEAD, 0.0), ('a', LEFT, 0.001), ('due', None, 0.001),
        ('due', LEFT, 0.01),
    ],
    'a release is due at once and only once': [
        ('a', AHEAD, 0.0), ('due', AHEAD, 0.0), ('a', REST, 0.001), ('due', REST, 0.001),
        ('due', None, 1.0),
    ],
    'a page that closes with a key held brakes': [
        ('a', AHEAD, 0.0), ('due', AHEAD, 0.0), ('a', 'closes', 0.0), ('due', BRAKE, 0.001),
        ('due', None, 1.0), ('driver', None, 1.0),
    ],
    'a watching page changes nothing when it closes': [
        ('a', AHEAD, 0.0), ('b', 'closes', 0.0), ('driver', 'a', 0.0), ('due', AHEAD, 0.0),
    ],
    'a page that closes with no key held changes nothing': [
        ('a', AHEAD, 0.0), ('a', REST, 0.1), ('due', None, 0.1), ('a', 'closes', 0.1),
        ('due', None, 0.2),
    ],
    'a silent page brakes': [
        ('a', AHEAD, 0.0), ('due', AHEAD, 0.0), ('due', AHEAD, STALE),
        ('due', BRAKE, STALE + 0.001), ('due', None, 10.0),
    ],
    'the first page drives and others are refused': [
        ('a', AHEAD, 0.0), ('b', 'refused', 0.1), ('driver', 'a', 0.1), ('due', AHEAD, 0.1),
    ],
    'another page drives when the driver has closed': [
        ('a', AHEAD, 0.0), ('a', 'closes', 0.0), ('b', LEFT, 0.1), ('driver', 'b', 0.1),
    ],
    'another page drives only after the driver was idle': [
        ('a', AHEAD, 0.0), ('a', REST, 1.0), ('due', None, 1.0), ('b', 'refused', 1.0 + IDLE),
        ('b', LEFT, 1.001 + IDLE),
    ],
    'nobody drives after the driver was idle': [
        ('a', AHEAD, 0.0), ('a', REST, 1.0), ('due', None, 1.0), ('due', None, 1.001 + IDLE),
        ('driver', None, 1.001 + IDLE),
    ],
    'messages without a key do not keep the driver': [
        ('a', AHEAD, 0.0), *(('a', REST, 1.0 + 0.1 * k) for k in range(100)), ('b', LEFT, 11.0),
    ],
}  # fmt: skip


@pytest.mark.parametrize('steps', CASES.values(), ids=CASES)
def test_who_drives_and_what_is_due(steps: list[tuple[str, Drive | str | None, float]]) -> None:
    arbiter = DriverArbiter()
    for who, what, t in steps:
        if who == 'due':
            assert arbiter.due(t) == what, t
        elif who == 'driver':
            assert arbiter.driver == what
        elif what == 'closes':
            arbiter.leave(who)
        elif isinstance(what, Drive):
            assert arbiter.request(who, what, t)
        else:
            assert not arbiter.request(who, LEFT, t)


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
