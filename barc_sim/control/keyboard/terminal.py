"""The terminal as a keyboard: raw while it is read, and restored at the end.

The settings are made by hand: `tty.setraw` would also turn off the output's processing, which the
run's lines need, and curses would clear the screen.
"""

from __future__ import annotations

import os
import select
from contextlib import suppress
from threading import Lock, Thread, current_thread
from typing import TYPE_CHECKING

from barc_sim.control.keyboard.keys import KeyDecoder, KeyEvent
from barc_sim.errors import UserError

try:
    import termios
except ModuleNotFoundError:  # on Windows
    termios = None  # type: ignore[assignment]

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

    from typing_extensions import Self

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
        """Use the terminal at the file descriptor `fd`.

        Raises
        ------
        UserError
            if it is no terminal, or this process is not in its foreground.
        """
        why = _unusable(fd)
        if why:
            raise UserError(
                f'no keys are read, as {why}: start it in the foreground of a terminal, or drive '
                'with another publisher of cmd_vel'
            )
        self._fd = fd
        self._lock = Lock()
        self._settings: list[int | list[bytes | int]] | None = None
        self._kitty = False
        self._thread: Thread | None = None

    def __enter__(self) -> Self:
        """Return the terminal."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
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
        return 'this system has no termios'
    if not os.isatty(fd):
        return 'the standard input is no terminal'
    try:
        foreground = os.tcgetpgrp(fd)
    except OSError:  # not the controlling terminal: reading from it is not stopped
        return None
    return None if foreground == os.getpgrp() else 'this process runs in the background'
