"""Turns the bytes of a terminal into keys, and the keys that are held into a driver's input.

The terminal is set without `tty.setraw`, which would also turn off the output's processing, and
without curses, which would clear the screen.
"""

from __future__ import annotations

import os
import re
import select
from contextlib import suppress
from math import inf
from threading import Lock, Thread, current_thread
from typing import TYPE_CHECKING

from barc_sim.control.driver import COAST, FULL_BRAKE, DriverInput
from barc_sim.errors import UserError

try:
    import termios
except ModuleNotFoundError:  # on Windows
    termios = None  # type: ignore[assignment]

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from typing_extensions import Self

#: [s] A first press lasts longer than the delay before the first repeat (0.66 s of X11, usually
#: 0.5 s), and a repeat longer than the usual time to the next one.
PRESS_HOLD = 0.75
REPEAT_HOLD = 0.15
_ARROWS = {'A': 'up', 'B': 'down', 'C': 'right', 'D': 'left'}
_LETTERS = {
    'w': 'up',
    's': 'down',
    'd': 'right',
    'a': 'left',
    'z': 'up',
    ' ': 'space',
    'r': 'reset',
    'q': 'quit',
    '\x03': 'quit',
}
#: On a French keyboard, where ZQSD are in the place of WASD.
_LETTERS_ZQSD = _LETTERS | {'q': 'left'}
_DRIVING = ('up', 'down', 'left', 'right', 'space')

#: What a terminal sends in several characters: a function key of the Linux console, the report of a
#: mouse, a key, a key of the keypad, a text (its answer to a program), or Alt with another key.
_SEQUENCE = re.compile(
    r'\x1b(?:'
    r'\[\[.|'
    r'\[M.{3}|'
    r'\[(?P<key>[@-LN-Z\\-~])|'
    r'\[[ -?]{1,64}(?P<shifted>[@-~])|'
    r'O(?P<keypad>.)|'
    r'[]PX^_][^\x07\x1b]{0,4096}(?:\x07|\x1b\\)|'
    r'[^][OPX^_\x1b]'
    r')',
    re.DOTALL,
)
_BEGINNING = re.compile(
    r'\x1b(?:\[(?:\[?|M.{0,2}|[ -?]{1,64})|O|[]PX^_][^\x07\x1b]{0,4096}\x1b?)?', re.DOTALL
)


class KeyDecoder:
    """Decodes the bytes that a terminal sends; a sequence may arrive in any number of pieces.

    Keys are up, down, left, right, space, reset and quit. All other bytes are ignored, and so is a
    key after a lone Escape, which is how a terminal sends Alt. Ctrl-C is never ignored.

    From the first `z` on, ZQSD steer as WASD do, and only Ctrl-C is quit: on a French keyboard they
    are in the same place.
    """

    def __init__(self) -> None:
        """Start outside of any sequence."""
        self._sequence = ''
        self._letters = _LETTERS

    @property
    def is_waiting(self) -> bool:
        """Whether a sequence has begun that has not ended."""
        return bool(self._sequence)

    def give_up(self) -> None:
        """Forget the sequence that has begun: what follows is not a part of it."""
        self._sequence = ''

    def decode(self, data: bytes) -> Iterator[str]:
        """Yield the keys that end in `data`."""
        for character in data.decode('latin-1'):
            if character == '\x03':
                self._sequence = ''
                yield 'quit'
            elif self._sequence or character == '\x1b':
                yield from self._continue_sequence(character)
            else:
                yield from self._decode_letter(character.lower())

    def _decode_letter(self, letter: str) -> Iterator[str]:
        if letter == 'z':
            self._letters = _LETTERS_ZQSD
        if letter in self._letters:
            yield self._letters[letter]

    def _continue_sequence(self, character: str) -> Iterator[str]:
        sequence = self._sequence + character
        match = _SEQUENCE.fullmatch(sequence)
        if match:
            self._sequence = ''
            key = match[match.lastgroup] if match.lastgroup else ''
            if key in _ARROWS:
                yield _ARROWS[key]
            return

        if not _BEGINNING.fullmatch(sequence):
            # Another one can have begun in it.
            sequence = sequence[sequence.rindex('\x1b') :]
            if not _BEGINNING.fullmatch(sequence):
                sequence = ''
        self._sequence = sequence


class HeldKeys:
    """Keeps which keys are held, and returns the driver's input for them.

    A terminal reports no release: a key counts as held for `PRESS_HOLD` after it was pressed, and
    for `REPEAT_HOLD` after each repeat. Only the key pressed last repeats.
    """

    def __init__(self) -> None:
        """Start with no key held."""
        self._until: dict[str, float] = {}
        self._previous = COAST

    def handle(self, key: str, t: float) -> bool:
        """Handle a `key` at `t` [s]; return whether it is a new press, not a repeat."""
        until = self._until.get(key, -inf)
        is_press = until < t
        hold = PRESS_HOLD if is_press else REPEAT_HOLD
        self._until[key] = max(until, t + hold)
        return is_press

    def held(self, t: float) -> tuple[str, ...]:
        """Return the driving keys held at `t` [s]."""
        return tuple(key for key in _DRIVING if self._until.get(key, -inf) >= t)

    def request(self, t: float) -> DriverInput | None:
        """Return the driver's input at `t` [s]; after the release, coasting once and then None.

        After the brake there is no coasting, so that the brake stays on.
        """
        keys = self.held(t)
        request = DriverInput(
            forward=float('up' in keys) - float('down' in keys),
            turn=float('left' in keys) - float('right' in keys),
        )
        if 'space' in keys:
            request = FULL_BRAKE

        previous = self._previous
        self._previous = request
        is_released = not keys and previous in {COAST, FULL_BRAKE}
        return None if is_released else request


_CHUNK = 1024
#: [s] A terminal sends a sequence at once: after this pause, the rest of it does not come.
_SEQUENCE_PAUSE = 0.2


class Terminal:
    """Reads keys from a terminal in a thread of its own, from `listen` to `close`.

    Meanwhile keys are not echoed and send no signals; output is not changed.
    """

    def __init__(self, fd: int = 0) -> None:
        """Use the terminal at the file descriptor `fd`."""
        obstacle = _unusable(fd)
        if obstacle:
            raise UserError(
                f'{obstacle}: keys are ignored; start it in the foreground of a terminal, or drive '
                'in the page, or with another publisher of cmd_vel'
            )
        self._fd = fd
        self._lock = Lock()
        self._settings: list[int | list[bytes | int]] | None = None
        self._thread: Thread | None = None

    def __enter__(self) -> Self:
        """Return the terminal."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def listen(self, on_key: Callable[[str], object]) -> None:
        """Make the terminal raw, and call `on_key` from a thread for each key.

        The end of the terminal is the key `quit`. `on_key` must not wait for the thread that
        closes the terminal, because that thread waits for `on_key`.
        """
        with self._lock:
            settings = termios.tcgetattr(self._fd)
            self._settings = settings

            raw = [*settings[:6], [*settings[6]]]
            raw[0] &= ~(termios.IXON | termios.ICRNL | termios.INLCR | termios.ISTRIP)
            raw[3] &= ~(termios.ICANON | termios.ECHO | termios.ISIG | termios.IEXTEN)
            raw[6][termios.VMIN] = 1
            raw[6][termios.VTIME] = 0
            termios.tcsetattr(self._fd, termios.TCSANOW, raw)

            woken, self._wake = os.pipe()
        self._thread = Thread(target=self._read, args=(woken, on_key), name='keys', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Restore the terminal; may be called from any thread, and again."""
        self._restore()
        # Even if it is restored already: the reading thread must have ended.
        thread = self._thread
        if thread and thread is not current_thread():
            thread.join()

    def _restore(self) -> None:
        with self._lock:
            settings = self._settings
            self._settings = None
            if settings is None:
                return

            with suppress(termios.error):  # the terminal may be gone
                # Discard what was typed, so that the shell does not read it. TCSAFLUSH would wait
                # for a terminal that accepts no output.
                termios.tcflush(self._fd, termios.TCIFLUSH)
                termios.tcsetattr(self._fd, termios.TCSANOW, settings)
            os.close(self._wake)

    def _read(self, woken: int, on_key: Callable[[str], object]) -> None:
        decoder = KeyDecoder()
        with open(woken, 'rb'):
            while True:
                pause = _SEQUENCE_PAUSE if decoder.is_waiting else None
                ready, _, _ = select.select([self._fd, woken], [], [], pause)
                if woken in ready:
                    return
                if not ready:
                    decoder.give_up()
                    continue

                data = b''
                with suppress(OSError):
                    data = os.read(self._fd, _CHUNK)
                for key in decoder.decode(data):
                    on_key(key)
                if not data:
                    on_key('quit')
                    return


def _unusable(fd: int) -> str | None:
    """Return why no keys can be read from `fd`; None if they can."""
    if not termios:
        return 'the system has no terminal of POSIX'
    if not os.isatty(fd):
        return 'standard input is not a terminal'
    try:
        foreground = os.tcgetpgrp(fd)
    except OSError:  # not the controlling terminal: reading from it is not stopped
        return None
    return None if foreground == os.getpgrp() else 'this process runs in the background'
