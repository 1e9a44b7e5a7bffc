"""Keys of a terminal: what bytes mean, however they arrive, and for how long a key is held."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from barc_sim.control.driver import COAST, FULL_BRAKE, DriverInput
from barc_sim.control.keyboard import PRESS_HOLD, REPEAT_HOLD, HeldKeys, KeyDecoder

KEYS = {
    b'w': 'up',
    b'W': 'up',
    b'a': 'left',
    b's': 'down',
    b'D': 'right',
    b' ': 'space',
    b'r': 'reset',
    b'q': 'quit',
    b'\x03': 'quit',
    b'\x1b[A': 'up',
    b'\x1b[B': 'down',
    b'\x1b[C': 'right',
    b'\x1b[D': 'left',
    b'\x1bOA': 'up',
    b'\x1b[1;2D': 'left',
}


def keys_of(*pieces: bytes) -> list[str]:
    decoder = KeyDecoder()
    return [key for piece in pieces for key in decoder.decode(piece)]


@pytest.mark.parametrize(('data', 'key'), KEYS.items())
def test_each_key_is_decoded_also_byte_by_byte(data: bytes, key: str) -> None:
    assert keys_of(data) == [key]
    assert keys_of(*(bytes([byte]) for byte in data)) == [key]


@pytest.mark.parametrize(
    'data',
    [
        *(b'xyv\xff\x00\r\n\t', b'\x1bw', b'\x1b[3~', b'\x1bOP'),
        # Of the Linux console: F1 to F5.
        *(b'\x1b[[A', b'\x1b[[B', b'\x1b[[C', b'\x1b[[D', b'\x1b[[E'),
        # What terminals answer, and what a mouse sends.
        *(b'\x1b[?62;c', b'\x1b[24;80R', b'\x1b]11;rgb:ffff/aaaa/dddd\x07'),
        *(b'\x1b]11;rgb:ffff/aaaa/dddd\x1b\\', b'\x1bP1$r0 q\x1b\\', b'\x1bP>|tmux 3.4 wasd\x1b\\'),
        *(b'\x1b_Gi=31;OK quit\x1b\\', b'\x1b[Mqaw', b'\x1b[<0;1;1M', b'\x1b[?1;2c', b'\x1b[I'),
    ],
)
def test_other_keys_are_ignored(data: bytes) -> None:
    assert keys_of(data, b'\x1b\x1b[A') == ['up']
    assert keys_of(*(bytes([byte]) for byte in data), b'\x1b[A') == ['up']


def test_a_text_that_is_broken_off_by_a_key_ends_there() -> None:
    assert keys_of(b'\x1b]11;rgb:\x1b[A') == ['up']


def test_after_z_q_steers_left_and_only_ctrl_c_quits() -> None:
    assert keys_of(b'zqsd') == ['up', 'left', 'down', 'right']
    assert keys_of(b'q', b'Z', b'Q\x03') == ['quit', 'up', 'left', 'quit']


def test_an_unfinished_sequence_can_be_dropped() -> None:
    decoder = KeyDecoder()
    assert [*decoder.decode(b'\x1b]11')] == []
    assert decoder.is_waiting
    decoder.give_up()
    assert [*decoder.decode(b'w')] == ['up']


def test_ctrl_c_counts_even_in_a_sequence() -> None:
    assert keys_of(b'\x1b[1;\x03', b'w') == ['quit', 'up']


def test_an_endless_sequence_is_dropped() -> None:
    assert 'up' in keys_of(b'\x1b[' + b'1' * 1000, b'w', b'w')


@given(st.binary(max_size=300))
def test_no_bytes_do_harm(data: bytes) -> None:
    request = press(*keys_of(data)).request(0.0)
    assert request is None or all(-1.0 <= share <= 1.0 for share in request)


def press(*keys: str) -> HeldKeys:
    held = HeldKeys()
    for key in keys:
        held.handle(key, 0.0)
    return held


@pytest.mark.parametrize(
    ('keys', 'expected'),
    [
        (['up'], DriverInput(forward=1.0)),
        (['down'], DriverInput(forward=-1.0)),
        (['left'], DriverInput(turn=1.0)),
        (['right'], DriverInput(turn=-1.0)),
        (['up', 'left'], DriverInput(forward=1.0, turn=1.0)),
        (['up', 'down'], COAST),
        (['up', 'left', 'space'], FULL_BRAKE),
    ],
)
def test_held_keys_make_the_drivers_input(keys: list[str], expected: DriverInput) -> None:
    assert press(*keys).request(0.1) == expected


def test_a_single_press_holds_then_gives_zero_once_then_nothing() -> None:
    held = press('up')
    held.handle('up', 0.1)  # an early repeat does not shorten it
    assert held.request(PRESS_HOLD) == DriverInput(forward=1.0)
    assert held.request(PRESS_HOLD + 0.01) == COAST
    assert held.request(PRESS_HOLD + 0.06) is None
    assert held.request(9.0) is None


def test_a_key_that_repeats_is_held_until_shortly_after_the_last_repeat() -> None:
    held = press('up')
    last = 0.5 + 33 * 0.03
    for k in range(34):  # as a keyboard does: half a second's delay, then 33 a second
        t = 0.5 + k * 0.03
        assert held.held(t) == ('up',)
        held.handle('up', t)
    assert held.request(last + REPEAT_HOLD - 0.01) == DriverInput(forward=1.0)
    assert held.request(last + REPEAT_HOLD + 0.01) == COAST


@pytest.mark.parametrize('delay', [0.25, 0.5, 0.66])  # the last one is X11's
def test_a_key_is_held_from_its_press_through_the_delay_of_its_repeats(delay: float) -> None:
    held = press('up')
    for t in (0.0, 0.5 * delay, delay, delay + 0.04):
        assert held.held(t) == ('up',)


def test_a_press_after_the_hold_is_a_first_press_again() -> None:
    held = press('up')
    held.handle('up', 10.0)
    assert held.request(10.0 + PRESS_HOLD) == DriverInput(forward=1.0)


def test_nothing_follows_the_brake_so_that_it_stays_on() -> None:
    held = press('space')
    assert held.request(0.0) == FULL_BRAKE
    assert held.request(PRESS_HOLD + 0.01) is None
