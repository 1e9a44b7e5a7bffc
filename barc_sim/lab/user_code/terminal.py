"""A keyboard in simulated time, for programs that read the terminal, or keys from a topic.

What a program imports to read a terminal is replaced: nothing reads the real one, so that a program
gets the same keys at the same times on every machine, also where it is confined.
"""

from __future__ import annotations

import os
import select
import sys
import threading
from collections import deque
from math import inf
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from barc_sim.lab.user_code.importing import Absent
from barc_sim.ros.local.executor import SECOND

if TYPE_CHECKING:
    from collections.abc import Sequence

    from barc_sim.ros.local.executor import World

#: The keys for up, down, left and right that programs use; the likelier ones last, except `w s`,
#: because a program for `w x` can stop at s.
LAYOUTS = {
    'arrows': ('\x1b[A', '\x1b[B', '\x1b[D', '\x1b[C'),
    'w x a d': tuple('wxad'),
    'w s a d': tuple('wsad'),
    'i , j l': tuple('i,jl'),
    'i k j l': tuple('ikjl'),
    '8 2 4 6': tuple('8246'),
}
STOP = ' '  #: the key that stops in most programs, as any other key does
#: The codes of the arrows in `keyboard/Key`; other keys have their letters' codes.
CODES = dict(zip(LAYOUTS['arrows'], (273, 274, 276, 275), strict=True))
#: What reads keys in another way, words.
_ELSEWHERE = 'curses getch getkey pygame pynput readchar tkinter Tkinter'
_SET_FLAGS = 4  # as on Linux
_TICK = 1_000_000  # [ns] that a look for a key takes at least, so that a busy loop takes time


class _Constants(SimpleNamespace):
    """A module whose other names are 0: its constants, which nothing reads."""

    def __getattr__(self, _: str) -> int:
        return 0


class _NoThread(threading.Thread):
    def start(self) -> None:
        raise RuntimeError("can't start new thread")


class Terminal:
    """The standard input of a program; `type` adds keys."""

    def __init__(self, world: World) -> None:
        self.use = ''  #: how the program reads keys, as the rest of a sentence; empty: it does not
        self._world, self._typed = world, deque[str]()
        self._patience: float | None = None  # [s] of a read; None: for ever

    def type(self, keys: str) -> None:
        """Add the characters of keys, which are read one by one."""
        self._typed.extend(keys)

    def _wait(self, seconds: float | None) -> bool:
        """Let time pass until there is a character, at most for so long."""
        self.use = self.use or 'reads the terminal'
        now = self._world.now_ns
        until = inf if seconds is None else now + max(int(seconds * SECOND), _TICK)
        while not self._typed and self._world.now_ns < until:
            self._world.pass_time(until)
        return bool(self._typed)

    def read(self, size: int = 1) -> str:
        """Return so many characters, fewer where a read does not wait for them."""
        found = ''
        while len(found) < size and self._wait(self._patience):
            found += self._typed.popleft()
        return found

    def readline(self, prompt: object = '') -> str:
        """Return a line: one key."""
        del prompt
        return f'{self.read()}\n'

    def fileno(self) -> int:
        """Return the number of the standard input."""
        return 0

    def isatty(self) -> bool:
        """Return True."""
        return True

    @property
    def buffer(self) -> SimpleNamespace:
        """The same, in bytes."""
        return SimpleNamespace(read=lambda size=1: self.read(size).encode())

    def _select(
        self,
        readers: Sequence[Any],
        writers: Sequence[Any],
        _: object,
        timeout: float | None = None,
    ) -> tuple[list[Any], Sequence[Any], list[Any]]:
        own = [each for each in readers if each in (0, self)]
        return (own if own and self._wait(timeout) else []), writers, []

    def _read_file(self, file: int, size: int) -> bytes:
        if file:
            return os.read(file, size)
        if keys := self.read(min(size, max(len(self._typed), 1))):
            return keys.encode()
        raise BlockingIOError('Resource temporarily unavailable')

    def _attributes(self, *_: object) -> list[Any]:
        self.use = self.use or 'reads the terminal'
        return [0, 0, 0, 0, 0, 0, [0] * 32]

    def _set_flags(self, _: object, command: int = 0, flags: int = 0) -> int:
        if command == _SET_FLAGS:
            self._patience = 0.0 if flags & getattr(os, 'O_NONBLOCK', 0) else None
        return 0

    def modules(self) -> dict[str, Any]:
        """Return the modules with which a program reads keys."""
        return {
            'sys': SimpleNamespace(**{**vars(sys), 'stdin': self}),
            'os': SimpleNamespace(**{**vars(os), 'read': self._read_file}),
            'select': SimpleNamespace(**{**vars(select), 'select': self._select}),
            'threading': SimpleNamespace(**{**vars(threading), 'Thread': _NoThread}),
            'tty': SimpleNamespace(setraw=self._attributes, setcbreak=self._attributes),
            'termios': _Constants(
                error=OSError,
                tcgetattr=self._attributes,
                tcsetattr=self._attributes,
                tcflush=lambda *_: self._typed.clear(),
            ),
            'fcntl': _Constants(F_SETFL=_SET_FLAGS, fcntl=self._set_flags),
        }

    def elsewhere(self, name: str) -> Absent | None:
        """Return what stands for a module that reads keys in a way that nobody can type for."""
        top = name.partition('.')[0]
        if top not in _ELSEWHERE.split():
            return None
        self.use = f'uses {top}'
        return Absent(name, f'{top} reads keys, and no keys are typed for it')
