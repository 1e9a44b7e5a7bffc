"""Which command holds, and whether it answers the present state."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from barc_sim.vehicle.bike_model import Input


class Commands:
    """The commands that a simulator has heard since its start.

    A command answers the state whose stamp it bears. It takes the place of the one that holds
    unless it is older, or the present state has its answer. So neither what comes out of order nor
    what bears a stamp of the future can keep the answer out.

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
        until one answers it exactly.
        """
        self.timeout = timeout or inf
        self.latest: Input | None = None
        self.answered = self._as_they_please = bool(timeout)
        self._exactly = False  # answered by the present state's stamp
        self._order = 0  # [ns] the state that `latest` belongs to
        self._heard = -inf

    def usable(self, stamp: int, present: int) -> bool:
        """Return whether one with this `stamp` [ns] may hold in the state stamped `present`."""
        if self._exactly and stamp not in (0, present):
            return False
        return _order(stamp, present) >= self._order

    def hear(self, command: Input, stamp: int, present: int, t: float) -> None:
        """Take a usable `command`, at `t` [s]."""
        self.latest, self._order, self._heard = command, _order(stamp, present), t
        self._exactly = stamp == present
        if self._exactly or stamp == 0:
            self._as_they_please = stamp == 0
        self.answered = self._as_they_please or self._exactly

    def expect(self) -> None:
        """Go on to the next state."""
        self.answered = self._as_they_please
        self._exactly = False

    def wait(self, t: float) -> None:
        """Count silence from `t` [s] on."""
        self._heard = max(self._heard, t)

    def lost(self, t: float) -> bool:
        """Return whether the commands have been silent for too long at `t` [s]."""
        return t - self._heard > self.timeout


def _order(stamp: int, present: int) -> int:
    """Return which state [ns] a command belongs to; one of the future counts as of now."""
    return min(stamp, present) if stamp else present
