"""When the next step of a run is due, and which command it takes."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from barc_sim.vehicle.bike_model import Command

_NANOSECONDS = 1e9
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


class Commands:
    """The commands that a simulator has received since its start.

    A command answers the state with the same stamp. It replaces the command that holds, unless it
    is older or the present state is answered already. So neither a late command nor one with a
    stamp in the future can displace the answer.

    Attributes
    ----------
    latest
        The command that holds; None before the first one.
    answered
        Whether it is for the present state: it has the same stamp, or no stamp at all.
    timeout
        [s] Commands count as lost when none arrives for longer than this; inf: never.
    """

    def __init__(self, timeout: float = 0.0) -> None:
        """Begin before the first state.

        With a `timeout` [s] other than 0, commands are unsynchronised: none is due for a state
        until one arrives with exactly its stamp.
        """
        self.timeout = timeout or inf
        self.latest: Command | None = None
        self.answered = self._unsynchronised = bool(timeout)
        self._answered_by_stamp = False  # answered by a command with the present state's stamp
        self._latest_state = 0  # [ns] stamp of the state that `latest` belongs to
        self._received = -inf

    def store(self, command: Command, stamp: int, present: int, t: float) -> bool:
        """Let a `command` that arrived at `t` [s] hold from now on, in the state `present` [ns].

        Return False if its `stamp` [ns] is out of order: another one holds.
        """
        state = min(stamp, present) if stamp else present  # that it belongs to
        if state < self._latest_state or (self._answered_by_stamp and stamp not in (0, present)):
            return False
        self.latest, self._latest_state, self._received = command, state, t
        self._answered_by_stamp = stamp == present
        if self._answered_by_stamp or stamp == 0:
            self._unsynchronised = stamp == 0
        self.answered = self._unsynchronised or self._answered_by_stamp
        return True

    def next_step(self) -> None:
        """Wait for the answer to the next state."""
        self.answered = self._unsynchronised
        self._answered_by_stamp = False

    def start_timeout(self, t: float) -> None:
        """Measure the timeout from `t` [s], unless a command arrived later."""
        self._received = max(self._received, t)

    def timed_out(self, t: float) -> bool:
        """Return whether no command arrived for longer than the timeout, at `t` [s]."""
        return t - self._received > self.timeout


def out_of_order(stamp: int, present: int) -> str:
    """Return why a command with this `stamp` [ns] is not accepted in the state `present` [ns]."""
    away = (stamp - present) / _NANOSECONDS
    return f'a command stamped {away:+g} s from the present state: a newer one or its answer holds'
