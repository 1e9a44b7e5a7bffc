"""Who drives: one page at a time, and never one that has gone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.page.protocol import Drive

if TYPE_CHECKING:
    from collections.abc import Hashable

IDLE = 3.0  #: [s] without a key held after which another page may drive
STALE = 0.5  #: [s] without a word of the page after which what it held is let go
_PERIOD = 0.05  #: [s] between two commands while a key is held
_LEAST_PERIOD = 0.01  #: [s] between two commands, however often they change
_REST = Drive()
_BRAKE = Drive(brake=1.0)
_LASTING = (_REST, _BRAKE)  # whoever listens goes on with them: they are said once


class Wheel:
    """Gives the wheel to the first page that presses, until it leaves or has been idle.

    While something is held, `due` returns a command every 50 ms; then zero once, then nothing, so
    that others who publish `cmd_vel` are not drowned out. Where the page goes or falls silent with
    something held, the brake comes in place of zero. Times are of a clock that never steps.

    Attributes
    ----------
    driver
        The page that has the wheel, or None.
    """

    def __init__(self) -> None:
        """Nobody drives."""
        self.driver: Hashable | None = None
        self._command = self._sent = _REST
        self._heard = self._published = float('-inf')

    def turn(self, page: Hashable, command: Drive, now: float) -> bool:
        """Take what `page` holds at `now` [s]; return False where another page drives."""
        if self.driver != page:
            if command == _REST:
                return True
            if self.driver is not None and not self._idle(now):
                return False
            self.driver = page
        if command != _REST or self._command != _REST:
            self._heard = now
        self._command = command
        return True

    def leave(self, page: Hashable) -> None:
        """Brake where `page` held something: it has gone."""
        if self.driver == page:
            self.driver = None
            self._let_go()

    def due(self, now: float) -> Drive | None:
        """Return the command to publish at `now` [s], or None."""
        if now - self._heard > STALE:
            self._let_go()
        if self.driver is not None and self._idle(now):
            self.driver = None
        since = now - self._published
        if self._command == self._sent and self._command in _LASTING:
            return None
        if self._command in _LASTING or since >= _PERIOD:
            pass
        elif self._command == self._sent or since < _LEAST_PERIOD:
            return None
        self._sent = self._command
        self._published = now
        return self._command

    def _let_go(self) -> None:
        if self._command != _REST:
            self._command = _BRAKE

    def _idle(self, now: float) -> bool:
        return self._command in _LASTING and now - self._heard > IDLE
