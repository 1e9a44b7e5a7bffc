"""Which command holds, and whether it answers the present state."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from barc_sim.bike_model import Input


class Commands:
    """The commands that a simulator has heard since its start.

    Attributes
    ----------
    latest
        The one that holds; None where none was heard.
    answered
        Whether it is for the present state: it bears its stamp, or none at all.
    timeout
        [s] Silence for longer is a loss; infinite where that is to be borne.
    """

    def __init__(self, timeout: float = 0.0) -> None:
        """Begin before the first state.

        With a `timeout` [s] other than 0, commands come as they please: none is due for a state
        until one bears a stamp.
        """
        self.timeout = timeout or inf
        self.latest: Input | None = None
        self.answered = self._as_they_please = bool(timeout)
        self._heard = -inf

    def hear(self, command: Input, stamp: int, present: int, t: float) -> None:
        """Take a `command` with its `stamp` [ns], at `t` [s], in the state stamped `present`."""
        self.latest, self._heard = command, t
        self._as_they_please = stamp == 0
        self.answered = stamp in (0, present)

    def expect(self) -> None:
        """Go on to the next state."""
        self.answered = self._as_they_please

    def wait(self, t: float) -> None:
        """Count silence from `t` [s] on."""
        self._heard = max(self._heard, t)

    def lost(self, t: float) -> bool:
        """Return whether the commands have been silent for too long at `t` [s]."""
        return t - self._heard > self.timeout
