"""The terminal as a keyboard, in a real pseudo-terminal: raw for a while, and then as before."""

from __future__ import annotations

import os
import queue
from contextlib import suppress
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('termios')

import pty
import termios

from barc_sim.control.keyboard import Terminal
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator

DEADLINE = 100.0


class Pty:
    """A pseudo-terminal, and what a Terminal on it makes of what is typed."""

    def __init__(self) -> None:
        self.user, self.fd = pty.openpty()
        self.before = termios.tcgetattr(self.fd)
        self.keys: queue.Queue[str] = queue.Queue()

    def type(self, data: bytes) -> None:
        """Send what keys send."""
        os.write(self.user, data)

    def next(self) -> str:
        """Return the next key."""
        return self.keys.get(timeout=DEADLINE)

    def output_until(self, end: bytes) -> bytes:
        """Return what is written to the terminal, up to `end`."""
        data = b''
        while not data.endswith(end):
            data += os.read(self.user, 1)
        return data

    def settings(self) -> list[object]:
        """Return the terminal's settings."""
        return termios.tcgetattr(self.fd)


@pytest.fixture
def console() -> Iterator[Pty]:
    console = Pty()
    yield console
    os.close(console.fd)
    with suppress(OSError):  # a test may have done so
        os.close(console.user)


@pytest.fixture
def terminal(console: Pty) -> Iterator[Terminal]:
    with Terminal(console.fd) as terminal:
        terminal.listen(console.keys.put)
        yield terminal


@pytest.mark.usefixtures('terminal')
def test_keys_are_read_without_enter_and_not_echoed_and_lines_still_begin_at_the_left(
    console: Pty,
) -> None:
    console.type(b'w')
    assert console.next() == 'up'
    console.type(b'\x1b')
    console.type(b'[D')
    assert console.next() == 'left'
    os.write(console.fd, b'a\nb')
    assert console.output_until(b'b') == b'a\r\nb'


@pytest.mark.usefixtures('terminal')
def test_keys_count_again_after_a_sequence_that_has_no_end(console: Pty) -> None:
    """As after Alt and a bracket."""
    console.type(b'\x1b]')
    keys = []
    for _ in range(round(DEADLINE)):
        console.type(b'w')
        with suppress(queue.Empty):
            keys.append(console.keys.get(timeout=1.0))
            break

    assert keys == ['up']


def test_settings_are_as_before_after_close_and_not_meanwhile(
    console: Pty, terminal: Terminal
) -> None:
    assert console.settings() != console.before
    terminal.close()
    assert console.settings() == console.before
    terminal.close()
    assert console.settings() == console.before


@pytest.mark.usefixtures('terminal')
def test_end_of_the_terminal_is_a_quit(console: Pty) -> None:
    os.close(console.user)
    assert console.next() == 'quit'


def test_close_from_the_reading_thread_works(console: Pty) -> None:
    terminal = Terminal(console.fd)

    def on_key(key: str) -> None:
        terminal.close()
        console.keys.put(key)

    terminal.listen(on_key)
    console.type(b'q')
    console.next()
    assert console.settings() == console.before
    terminal.close()  # the thread has ended when this returns


def test_an_input_other_than_a_terminal_is_refused() -> None:
    reader, writer = os.pipe()
    try:
        with pytest.raises(
            UserError, match='standard input is not a terminal: keys are ignored; start it in the'
        ):
            Terminal(reader)
    finally:
        os.close(reader)
        os.close(writer)


def test_terminal_of_another_foreground_is_not_touched(
    console: Pty, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, 'tcgetpgrp', lambda _: os.getpgrp() + 1)
    with pytest.raises(UserError, match='this process runs in the background'):
        Terminal(console.fd)
    assert console.settings() == console.before
