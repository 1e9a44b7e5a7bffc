"""The calls of the methods that spin, and when each of them is over."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from math import inf
from threading import Event
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rclpy.task import Future


class SpinPhase(Enum):
    """The states of a `Spin` that is not over."""

    MANY = 'it executes callbacks until it is over'
    ONE_TO_COME = 'it ends with one callback, which has not begun'
    ONE_RUNS = 'its one callback runs'
    ONE_RAN = 'its one callback has returned'


@dataclass(eq=False, slots=True)
class Spin:
    """A call of one of the methods that spin.

    ===========  =======================================  ===========
    phase        event                                    next phase
    ===========  =======================================  ===========
    ONE_TO_COME  a callback or a step of a task begins    ONE_RUNS
    ONE_RUNS     it returns                               ONE_RAN
    ONE_RUNS     it lasts, and there is a deadline        over
    ONE_RAN      the next check                           over
    all          the future is done, the deadline passes  over
    all          shutdown, an exception                   over
    ===========  =======================================  ===========
    """

    future: Future
    deadline: float  #: [s]
    phase: SpinPhase
    over: Event = field(default_factory=Event)

    def is_done(self, expired: float) -> bool:
        """Return whether it may end; a deadline of `expired` [s] or earlier has passed."""
        if self.phase is SpinPhase.ONE_RAN or self.future.done() or self.future.cancelled():
            return True
        if self.phase is SpinPhase.ONE_RUNS:
            # As with rclpy's, a `spin_once` with a timeout need not outlast its callback.
            return self.deadline < inf
        return self.deadline <= expired
