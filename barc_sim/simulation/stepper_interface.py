"""What a `Stepper` is set to, and what it calls."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.vehicle.bike_model import Command

if TYPE_CHECKING:
    from barc_sim.vehicle.plant import Observation


class Settings(NamedTuple):
    """The limits and times of a `Stepper`.

    Examples
    --------
    >>> Settings(realtime_factor=0.0, distance=180.0).laps
    1
    """

    realtime_factor: float = 1.0  #: simulated seconds per second; 0: lock-step
    distance: float = inf  #: [m] a lap ends here
    laps: int = 1  #: the run ends after so many; 0: it goes on
    command_timeout: float = 0.0  #: [s] without a command, after which the car brakes; 0: never
    timeout_braking: float = 8.0  #: [m/s²] deceleration then
    max_command: Command = Command(100.0, 1.5)  #: a command beyond is refused


class Outputs:
    """What a `Stepper` calls; a simulator overrides it."""

    def publish_state(self, t: float, seen: Observation, stamp_ns: int) -> None:
        """Publish the state `t` [s] after the start, with its stamp [ns]."""

    def start_deadlines(self) -> None:
        """Call `Stepper.pass_deadline` every `Stepper.deadline_period` from now on."""

    def stop_deadlines(self) -> None:
        """Stop calling `Stepper.pass_deadline`."""

    def deliver_commands(self) -> None:
        """Pass commands that have arrived to `Stepper.take_command` at once."""

    def prepare_start(self, why: str) -> None:
        """Log `why`, reset the node that commands, and call `Stepper.start` when it is ready."""

    def finish(self) -> None:
        """End the run; may be called from any thread."""

    def warn_missed(self, state: int, missed: int) -> None:
        """Warn that no command answered `state` in time."""

    def warn_timeout(self, timeout: float) -> None:
        """Warn that no command has arrived for `timeout` [s], and that the car brakes."""

    def warn_behind(self, behind: float) -> None:
        """Warn that stamps are `behind` [s] the wall clock, and publish the time from now on."""
