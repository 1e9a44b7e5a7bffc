"""The console of Windows as a keyboard."""

from __future__ import annotations

import os
from threading import Event, Thread, current_thread
from typing import TYPE_CHECKING

from barc_sim.control.keyboard.keys import KeyDecoder, KeyEvent
from barc_sim.control.keyboard.terminal import Terminal
from barc_sim.errors import UserError

try:
    import msvcrt
except ModuleNotFoundError:  # not on Windows
    msvcrt = None  # type: ignore[assignment]

if TYPE_CHECKING:
    from collections.abc import Callable

#: Of a key that is no character, the console gives one of these first, then a letter.
_PREFIXES = ('\x00', '\xe0')
_ARROWS = {'H': 'up', 'P': 'down', 'M': 'right', 'K': 'left'}
#: [s] Between two looks at the console, which cannot be waited for.
_PERIOD = 0.01


class Console(Terminal):
    """Reads keys from the console in a thread of its own, from `listen` to `close`.

    It reports repeats of a held key, and no releases.
    """

    def __init__(self) -> None:
        """Use the console of the standard input.

        Raises
        ------
        UserError
            There is none.
        """
        if not os.isatty(0):
            raise UserError(
                'no keys are read, as the standard input is no console: drive in the page'
            )
        self._closed = Event()
        self._thread: Thread | None = None

    def listen(self, on_event: Callable[[KeyEvent], object]) -> None:
        """Call `on_event` from a thread for each key."""
        self._thread = Thread(target=self._poll, args=(on_event,), name='keys', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Read no more keys; may be called from any thread, and again."""
        self._closed.set()
        if self._thread and self._thread is not current_thread():
            self._thread.join()

    def _poll(self, on_event: Callable[[KeyEvent], object]) -> None:
        decoder = KeyDecoder()
        while not self._closed.wait(_PERIOD):
            while msvcrt.kbhit():  # type: ignore[attr-defined]
                key = msvcrt.getwch()  # type: ignore[attr-defined]
                if key in _PREFIXES:
                    arrow = _ARROWS.get(msvcrt.getwch())  # type: ignore[attr-defined]
                    events = [KeyEvent(arrow)] if arrow else []
                else:
                    events = [*decoder.decode(key.encode('latin-1', 'ignore'))]
                for event in events:
                    on_event(event)


def open_terminal() -> Terminal:
    """Return the terminal or console of the standard input.

    Raises
    ------
    UserError
        There is none, or its keys cannot be read.
    """
    return Console() if msvcrt else Terminal()
