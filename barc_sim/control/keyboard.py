"""The keyboard of a terminal: its bytes become keys, and the held keys a driver's input.

The decoding is by hand. Libraries for terminals (curses, prompt_toolkit) report no releases of
keys, which the kitty protocol does, or take over the whole screen, where the run draws its line.
The settings are by hand, too: `tty.setraw` would also turn off the output's processing, which the
run's lines need, and curses would clear the screen.
"""

from __future__ import annotations

import os
import re
import select
from contextlib import suppress
from math import inf
from threading import Lock, Thread, current_thread
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.control.driver import COAST, FULL_BRAKE, DriverInput
from barc_sim.errors import Parameter, UserError

try:
    import termios
except ModuleNotFoundError:  # on Windows
    termios = None  # type: ignore[assignment]

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from typing_extensions import Self

#: [s] A first press lasts longer than the usual delay before the first repeat (0.5 s), and a repeat
#: longer than the usual time to the next one.
PRESS_HOLD = 0.6
REPEAT_HOLD = 0.15
PARAMETERS = [
    Parameter(
        'press_hold',
        PRESS_HOLD,
        'time [s] for which a key counts as held after a press; longer than the delay before the '
        'key repeats',
        (0.05, 5.0),
        read_only=True,
    ),
    Parameter(
        'repeat_hold',
        REPEAT_HOLD,
        'time [s] for which a key counts as held after each repeat',
        (0.05, 5.0),
        read_only=True,
    ),
]

_ARROWS = {'A': 'up', 'B': 'down', 'C': 'right', 'D': 'left'}
_LETTERS = {
    'w': 'up',
    's': 'down',
    'd': 'right',
    'a': 'left',
    ' ': 'space',
    'r': 'reset',
    'q': 'quit',
    '\x03': 'quit',
}
_DRIVING = ('up', 'down', 'left', 'right', 'space')
_CTRL = 4  # in the protocol's sum of modifiers
_RELEASE = 3
_PASTE_BEGINS, _PASTE_ENDS = '200~', '201~'
#: A longer sequence is discarded.
_LONGEST = 64
_SEQUENCE = re.compile(r'(?P<code>\d*)(?::\d*)*(?:;(?P<modifiers>\d*)(?::(?P<event>\d*))?)?')


class KeyEvent(NamedTuple):
    """A key that was pressed, or released if the terminal reports that."""

    key: str  #: up, down, left, right, space, reset or quit; `blur`: the window lost the focus,
    #: `kitty`: the terminal offers the kitty keyboard protocol
    released: bool = False


class KeyDecoder:
    """Decodes the bytes that a terminal sends; a sequence may arrive in any number of pieces.

    It decodes plain keys, the arrows in both of their modes, the kitty keyboard protocol
    (https://sw.kovidgoyal.net/kitty/keyboard-protocol/) and focus reports. It ignores pasted text,
    all other bytes, and a key after a lone Escape, which is how a terminal sends Alt. Ctrl-C is
    never ignored.
    """

    def __init__(self) -> None:
        """Begin outside of any sequence."""
        self._sequence = ''
        self._pasting = False

    def decode(self, data: bytes) -> Iterator[KeyEvent]:
        """Yield the events that end in `data`."""
        for character in data.decode('latin-1'):
            yield from self._take(character)

    def _take(self, character: str) -> Iterator[KeyEvent]:
        sequence = self._sequence + character
        self._sequence = ''
        if character == '\x1b':
            self._sequence = character
        elif character < ' ' or len(sequence) == 1:
            key = _LETTERS.get(character.lower())
            if key and (character == '\x03' or not self._pasting):
                yield KeyEvent(key)
        elif sequence in {'\x1b[', '\x1bO'} or (
            sequence[1] == '[' and character < '@' and len(sequence) < _LONGEST
        ):
            self._sequence = sequence
        elif sequence[1] in '[O' and len(sequence) > 2:  # noqa: PLR2004 (more than it begins with)
            yield from self._end(sequence[2:])

    def _end(self, body: str) -> Iterator[KeyEvent]:
        """Yield what the sequence ESC [ `body` means."""
        if body in {_PASTE_BEGINS, _PASTE_ENDS}:
            self._pasting = body == _PASTE_BEGINS
        elif self._pasting:
            pass
        elif body == 'O':
            yield KeyEvent('blur')
        elif body[0] == '?' and body[-1] == 'u':
            yield KeyEvent('kitty')
        elif match := _SEQUENCE.fullmatch(body, 0, len(body) - 1):
            yield from _key(match, body[-1])


def _key(match: re.Match[str], final: str) -> Iterator[KeyEvent]:
    code, modifiers, event = (int(group) if group else 1 for group in match.groups())
    key = None
    if final in _ARROWS:
        key = _ARROWS[final]
    elif final == 'u' and (modifiers - 1) & _CTRL:
        key = 'quit' if code == ord('c') else None
    elif final == 'u' and code < 0x80:  # noqa: PLR2004 (ASCII)
        key = _LETTERS.get(chr(code).lower())
    if key:
        yield KeyEvent(key, released=event == _RELEASE)


class HeldKeys:
    """The keys that are held, and the driver's input that they make.

    Most terminals report no release. There a key counts as held for `press_hold` after it was
    pressed, and for `repeat_hold` after each repeat. Only the key pressed last repeats.
    """

    def __init__(self, press_hold: float = PRESS_HOLD, repeat_hold: float = REPEAT_HOLD) -> None:
        """Begin with nothing held; times in seconds."""
        self.releases = False  #: whether the terminal reports releases, set once it has
        self._press_hold, self._repeat_hold = press_hold, repeat_hold
        self._until: dict[str, float] = {}
        self._previous = COAST

    def handle(self, event: KeyEvent, t: float) -> bool:
        """Handle an `event` at `t` [s]; return whether it is a new press, not a repeat."""
        if event.key in ('kitty', 'blur'):
            self.releases = self.releases or event.key == 'kitty'
            if event.key == 'blur':
                self._until.clear()
            return False
        until = self._until.pop(event.key, -inf)
        if event.released:
            return False
        pressed = until < t
        if self.releases:
            until = inf
        else:
            until = max(until, t + (self._press_hold if pressed else self._repeat_hold))
        self._until[event.key] = until
        return pressed

    def held(self, t: float) -> tuple[str, ...]:
        """Return the driving keys held at `t` [s]."""
        return tuple(key for key in _DRIVING if self._until.get(key, -inf) >= t)

    def request(self, t: float) -> DriverInput | None:
        """Return the driver's input at `t` [s]; after the release, coasting once and then None.

        Nothing follows the brake, so that it stays on.
        """
        held = self.held(t)
        request = DriverInput(
            forward=float('up' in held) - float('down' in held),
            turn=float('left' in held) - float('right' in held),
        )
        if 'space' in held:
            request = FULL_BRAKE
        previous, self._previous = self._previous, request
        return request if held or previous not in {COAST, FULL_BRAKE} else None


#: Turns on bracketed paste and focus reports, and queries the kitty protocol.
_BEGIN = b'\x1b[?2004h\x1b[?1004h\x1b[?u'
#: Turns on sequences for all keys, with releases.
_PUSH_KITTY, _POP_KITTY = b'\x1b[>11u', b'\x1b[<u'
_END = b'\x1b[?1004l\x1b[?2004l'
_CHUNK = 1024


class Terminal:
    """Reads keys from a terminal in a thread of its own, from `listen` to `close`.

    Meanwhile keys are not echoed and send no signals; output is not changed.
    """

    def __init__(self, fd: int = 0) -> None:
        """Use the terminal at the file descriptor `fd`."""
        why = _unusable(fd)
        if why:
            raise UserError(
                f'{why}: keys are ignored; start it in the foreground of a terminal, or drive in '
                'the page, or with another publisher of cmd_vel'
            )
        self._fd = fd
        self._lock = Lock()
        self._settings: list[int | list[bytes | int]] | None = None
        self._kitty = False
        self._thread: Thread | None = None

    def __enter__(self) -> Self:
        """Return the terminal."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def listen(self, on_event: Callable[[KeyEvent], object]) -> None:
        """Make the terminal raw, and call `on_event` from a thread for each key.

        The end of the terminal is the event `quit`. `on_event` must not wait for the thread that
        closes the terminal, as that thread waits for it.
        """
        with self._lock:
            settings = termios.tcgetattr(self._fd)
            self._settings = settings
            raw = [*settings[:6], [*settings[6]]]
            raw[0] &= ~(termios.IXON | termios.ICRNL | termios.INLCR | termios.ISTRIP)
            raw[3] &= ~(termios.ICANON | termios.ECHO | termios.ISIG | termios.IEXTEN)
            raw[6][termios.VMIN], raw[6][termios.VTIME] = 1, 0
            termios.tcsetattr(self._fd, termios.TCSANOW, raw)
            self._write(_BEGIN)
            woken, self._wake = os.pipe()
        self._thread = Thread(target=self._read, args=(woken, on_event), name='keys', daemon=True)
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
            settings, self._settings = self._settings, None
            if settings is None:
                return
            self._write((_POP_KITTY if self._kitty else b'') + _END)
            with suppress(termios.error):  # the terminal may be gone
                # Discard what was typed, so that the shell does not read it. TCSAFLUSH would wait
                # for a terminal that accepts no output.
                termios.tcflush(self._fd, termios.TCIFLUSH)
                termios.tcsetattr(self._fd, termios.TCSANOW, settings)
            os.close(self._wake)

    def _read(self, woken: int, on_event: Callable[[KeyEvent], object]) -> None:
        decoder = KeyDecoder()
        with open(woken, 'rb'):
            while woken not in select.select([self._fd, woken], [], [])[0]:
                data = b''
                with suppress(OSError):
                    data = os.read(self._fd, _CHUNK)
                for event in decoder.decode(data):
                    if event.key == 'kitty':
                        self._use_kitty()
                    on_event(event)
                if not data:
                    on_event(KeyEvent('quit'))
                    return

    def _use_kitty(self) -> None:
        with self._lock:
            if self._settings and not self._kitty:
                self._kitty = True
                self._write(_PUSH_KITTY)

    def _write(self, data: bytes) -> None:
        with suppress(OSError):  # the terminal may be gone, or read-only
            if select.select([], [self._fd], [], 0.0)[1]:
                os.write(self._fd, data)


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
