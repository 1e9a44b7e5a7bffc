"""Decides which page drives: one at a time, and never one that has closed."""

from __future__ import annotations

from barc_sim.page.protocol import Drive

IDLE = 3.0  #: [s] without a key held after which another page may drive
STALE = 0.5  #: [s] without a message of the driving page after which its keys count as released
_PERIOD = 0.05  #: [s] between two commands while a key is held
_LEAST_PERIOD = 0.01  #: [s] between two commands that differ
_REST = Drive()
_BRAKE = Drive(brake=1.0)
_LASTING = (_REST, _BRAKE)  # sent once: they hold until the next command


class DriverArbiter:
    """Lets the first page that presses a key drive, until it closes or has been idle.

    While a key is held, `due` returns a command every 50 ms; after its release zero once, then
    nothing, so that other publishers of `cmd_vel` are not overridden. If the page closes or falls
    silent with a key held, the brake takes the place of zero. Times are of a monotonic clock.

    Attributes
    ----------
    driver
        The page that drives, or None.

    Examples
    --------
    >>> from barc_sim.page.protocol import Drive
    >>> arbiter = DriverArbiter()
    >>> arbiter.request('page 1', Drive(linear=1.0), now=0.0)
    True
    >>> arbiter.request('page 2', Drive(linear=-1.0), now=0.1)
    False
    """

    def __init__(self) -> None:
        self.driver: object | None = None
        self._command = self._sent = _REST
        self._received = self._published = float('-inf')  # [s]

    def request(self, page: object, command: Drive, now: float) -> bool:
        """Take the command of `page` at `now` [s]; return False if another page drives."""
        if self.driver != page:
            if command == _REST:
                return True
            if self.driver is not None and not self._idle(now):
                return False
            self.driver = page
        if command != _REST or self._command != _REST:
            self._received = now
        self._command = command
        return True

    def leave(self, page: object) -> None:
        """Brake if the closed `page` held a key."""
        if self.driver == page:
            self.driver = None
            self._release()

    def due(self, now: float) -> Drive | None:
        """Return the command to publish at `now` [s], or None."""
        if now - self._received > STALE:
            self._release()
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

    def _release(self) -> None:
        if self._command != _REST:
            self._command = _BRAKE

    def _idle(self, now: float) -> bool:
        return self._command in _LASTING and now - self._received > IDLE
