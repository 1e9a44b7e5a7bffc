"""Simulated time against the wall clock: when the next step is due, and how late it is."""

from __future__ import annotations

#: Share of a period by which a deadline may be late and still count as punctual.
PUNCTUAL = 0.1
#: [s] by which stamps may be behind the wall clock in real time: a usual tolerance of tf2's users.
TOLERATED = 0.1


class Pace:
    """The deadlines of a run in real time, one every `period` [s] of the wall clock.

    Attributes
    ----------
    slipped
        Periods by which simulated time has fallen behind the wall clock.
    """

    def __init__(self, period: float) -> None:
        """Set no deadline yet; `begin` does."""
        self.period = period
        self.slipped = 0
        self._due = 0.0

    def begin(self, now: float) -> None:
        """Set the next deadline to one period after `now` [s]."""
        self._due = now + self.period

    def pass_deadline(self, now: float) -> bool:
        """Set the next deadline; return whether this one was punctual.

        Lost time is not made up: whole periods since the deadline are counted in `slipped`.
        """
        late = max(now - self._due, 0.0)
        behind = int(late / self.period)
        self._due += (behind + 1) * self.period
        self.slipped += behind
        return late <= PUNCTUAL * self.period
