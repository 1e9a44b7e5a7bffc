"""The console of Windows, with a stand-in for its module of Python."""

from __future__ import annotations

from collections import deque
from queue import SimpleQueue
from typing import TYPE_CHECKING

import pytest

from barc_sim.control import keyboard as module
from barc_sim.control.keyboard import Console, open_terminal
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from barc_sim.control.keyboard import KeyEvent


class Msvcrt:
    """Gives the typed characters, as the module `msvcrt` does."""

    def __init__(self, typed: str) -> None:
        self._typed = deque(typed)

    def kbhit(self) -> bool:  # noqa: D102 (its names)
        return bool(self._typed)

    def getwch(self) -> str:  # noqa: D102
        return self._typed.popleft()


def test_letters_arrows_and_ctrl_c_are_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    typed = 'w\xe0H\x00K\xe0S x\u20acR\x03'
    monkeypatch.setattr(module, 'msvcrt', Msvcrt(typed))
    monkeypatch.setattr('os.isatty', lambda _: True)
    keys: SimpleQueue[KeyEvent] = SimpleQueue()
    with open_terminal() as keyboard:
        keyboard.listen(keys.put)
        found = [keys.get(timeout=10.0).key for _ in range(6)]
    assert isinstance(keyboard, Console)
    assert found == ['up', 'up', 'left', 'space', 'reset', 'quit']
    assert keys.empty()
    keyboard.close()


def test_without_a_console_the_page_drives(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, 'msvcrt', Msvcrt(''))
    monkeypatch.setattr('os.isatty', lambda _: False)
    with pytest.raises(UserError, match='standard input is not a console'):
        open_terminal()


def test_without_termios_no_keys_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, 'termios', None)
    with pytest.raises(UserError, match='this system has no termios: keys are ignored'):
        open_terminal()
