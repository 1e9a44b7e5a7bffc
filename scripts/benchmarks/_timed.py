"""A cruise-control run whose steps are timed."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np
from _jitter import Clock

from barc_sim.__main__ import parse
from barc_sim.ros.carrier import DdsCarrier
from barc_sim.ros.process import new_executor
from barc_sim.runs.acc import add_car
from barc_sim.runs.composition import Run
from barc_sim.runs.inputs import read_inputs
from barc_sim.runs.terminal import Display

if TYPE_CHECKING:
    from barc_sim.cli.process import StopSignals

_PERIOD = 0.02  # s


class TimedRun(Display):
    """Notes when each state was published: in real time by several clocks, in lock-step by one.

    To read how long the thread waited takes as long as a step in lock-step.

    Parameters
    ----------
    arguments
        Options of `python -m barc_sim.run acc`.
    """

    def __init__(self, *arguments: str) -> None:
        self.clock = Clock()
        self.steps: list[float] = []  #: [s]
        self.first = 0.0  #: [s] since the epoch
        options = parse('acc', ['--quiet', *arguments])
        options.engine = 'ros'
        self.run = Run(options, read_inputs(options), DdsCarrier())
        self.car = add_car(self.run, 0)
        self.in_lock_step = not self.car.simulator.values['realtime_factor']
        self.car.display = self
        self.run.prepare()

    def show(self, *_: object) -> None:
        """Note that a state was published now."""
        self.first = self.first or time.time()
        self.steps.append(time.perf_counter())
        if not self.in_lock_step:
            self.clock()

    def spin(self, stop: StopSignals, executor: Any = None) -> None:  # noqa: ANN401 (any executor)
        """Spin the nodes until the run has ended, and end them."""
        stop.then(self.run.finish)
        executor = executor or new_executor()
        with self.run:
            for node in self.run.nodes:
                executor.add_node(node)
            executor.spin_until_future_complete(self.run.finished)
            self.run.await_readers(executor)
            executor.shutdown()

    def timing(self) -> dict[str, float]:
        """Return how far steps were from their period [ms], and the share of a core [%].

        The second figure leaves out what the thread waited for a core, as a busy machine makes it.
        """
        steps, waited, processor, _ = np.array(self.clock.ticks).T
        off = np.abs(np.diff(steps) - _PERIOD) * 1e3
        taken = steps[-1] - steps[0]
        without = np.maximum(off - waited[1:] * 1e3, 0.0)
        return {
            'jitter p99, ms': float(np.percentile(off, 99)),
            'without waits, ms': float(np.percentile(without, 99)),
            'p50, ms': float(np.percentile(off, 50)),
            'max, ms': float(off.max()),
            'missed': self.car.simulator.stepper.missed,
            'slipped': self.run.slipped,
            'core, %': (processor[-1] - processor[0]) / taken * 100.0,
        }
