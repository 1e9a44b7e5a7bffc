"""Simulated time against the wall clock: when the next step is due, and how late it is."""

from __future__ import annotations

#: Share of a period by which a deadline that is judged may be late.
PUNCTUAL = 0.1


class Pace:
    """The deadlines of a run in real time, one every `period` [s] by the wall clock.

    Attributes
    ----------
    slipped
        Periods by which simulated time has fallen behind the wall clock.
    """

    def __init__(self, period: float) -> None:
        """Begin with `begin`."""
        self.period = period
        self.slipped = 0
        self._due = 0.0

    def begin(self, now: float) -> None:
        """Let the next deadline be a period after `now` [s]."""
        self._due = now + self.period

    def pass_deadline(self, now: float) -> bool:
        """Go on to the next deadline; return whether this one was kept, as far as it is ours.

        Whole periods that have passed since are given up, as time lost is not made up.
        """
        late = max(now - self._due, 0.0)
        behind = int(late / self.period)
        self._due += (behind + 1) * self.period
        self.slipped += behind
        return late <= PUNCTUAL * self.period
