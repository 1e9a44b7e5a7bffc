"""A cruise-control run whose steps are timed."""

from __future__ import annotations

import time

import numpy as np
from _jitter import Clock

from barc_sim.__main__ import parse
from barc_sim.lab.user_code.loading import UserCode
from barc_sim.runs.composition import Setup
from barc_sim.runs.cruise_control import CruiseControl
from barc_sim.runs.ros_engine import RosEngine
from barc_sim.runs.terminal.user_output import UserOutput

_PERIOD = 0.02  # s


class TimedRun(CruiseControl):
    """Notes when each state was published, by several clocks.

    Parameters
    ----------
    arguments
        Options of `python -m barc_sim.run acc`.
    """

    def __init__(self, *arguments: str) -> None:
        self.clock = Clock()
        self.first = 0.0  #: [s] since the epoch
        options = parse('acc', ['--quiet', *arguments])
        super().__init__(Setup(options, None, UserCode(), UserOutput(quiet=True), RosEngine()))
        (self._car,) = self.cars
        self._car.show = self.note

    def note(self, *_: object) -> None:
        """Note that a state was published now."""
        self.first = self.first or time.time()
        self.clock()

    def timing(self) -> dict[str, float]:
        """Return how far steps were from their period [ms], and the share of a core [%].

        The second figure leaves out what the thread waited for a core, as a busy machine makes it.
        """
        steps, waited, processor = np.array(self.clock.ticks).T
        off = np.abs(np.diff(steps) - _PERIOD) * 1e3
        taken = steps[-1] - steps[0]
        without = np.maximum(off - np.diff(waited) * 1e3, 0.0)
        return {
            'jitter p99, ms': float(np.percentile(off, 99)),
            'without waits, ms': float(np.percentile(without, 99)),
            'p50, ms': float(np.percentile(off, 50)),
            'max, ms': float(off.max()),
            'missed': self._car.simulator.stepper.missed,
            'slipped': self.slipped,
            'core, %': (processor[-1] - processor[0]) / taken * 100.0,
        }
