"""A cruise-control run whose steps are timed."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np
from _ticks import TickLog

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
    """Notes the time of each published state: in real time by several clocks, in lock-step by one.

    In lock-step, the other clocks would take as long as a step.

    Parameters
    ----------
    arguments
        Options of `python -m barc_sim.run acc`.
    """

    def __init__(self, *arguments: str) -> None:
        self.log = TickLog()
        self.steps: list[float] = []  #: [s]
        self.first_state = 0.0  #: [s] since the epoch

        options = parse('acc', ['--quiet', *arguments])
        options.engine = 'ros'
        self.run = Run(options, read_inputs(options), DdsCarrier())
        self.car = add_car(self.run, 0)
        self.car.display = self
        self.in_lock_step = not self.car.simulator.values['realtime_factor']
        self.run.prepare()

    def show(self, *_: object) -> None:
        """Note that a state was published now."""
        if not self.steps:
            self.first_state = time.time()
        self.steps.append(time.perf_counter())
        if not self.in_lock_step:
            self.log.note()

    def spin(self, stop: StopSignals, executor: Any = None) -> None:  # noqa: ANN401 (any executor)
        """Spin the nodes until the run has ended, and end them."""
        stop.then(self.run.finish)
        if executor is None:
            executor = new_executor()

        with self.run:
            for node in self.run.nodes:
                executor.add_node(node)
            executor.spin_until_future_complete(self.run.finished)
            self.run.await_readers(executor)
            executor.shutdown()

    def timing(self) -> dict[str, float]:
        """Return how far steps were from their period [ms], and the share of a core [%].

        The second figure leaves out how long the thread waited for a core on a busy machine.
        """
        ticks = self.log.ticks
        times = np.array([tick.time for tick in ticks])
        waits = np.array([tick.wait for tick in ticks])
        jitter = np.abs(np.diff(times) - _PERIOD) * 1e3
        without_waits = np.maximum(jitter - waits[1:] * 1e3, 0.0)

        seconds = ticks[-1].time - ticks[0].time
        processor = ticks[-1].processor - ticks[0].processor
        return {
            'jitter p99, ms': float(np.percentile(jitter, 99)),
            'without waits, ms': float(np.percentile(without_waits, 99)),
            'p50, ms': float(np.percentile(jitter, 50)),
            'max, ms': float(jitter.max()),
            'missed': self.car.simulator.stepper.missed,
            'slipped': self.run.slipped,
            'core, %': processor / seconds * 100.0,
        }
