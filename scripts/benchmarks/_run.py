"""One cruise-control run for `run.py`: a task as JSON on the command line, its figures printed."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rclpy import executors
from rclpy.node import Node

from barc_sim.cruise_control import CruiseControl
from barc_sim.executor import QuickExecutor
from barc_sim.mirrors.options import MIRRORS
from barc_sim.process import NUM_THREADS, ros
from barc_sim.signals import StopSignals

if TYPE_CHECKING:
    from barc_sim.plant import Observation

#: [s] A stock executor may need minutes for a course in lock-step: it is stopped here.
_LOCK_STEP_LIMIT = 10.0
_EXECUTORS = {
    'ours': lambda: QuickExecutor(num_threads=NUM_THREADS),
    'single': executors.SingleThreadedExecutor,
    'multi': lambda: executors.MultiThreadedExecutor(num_threads=NUM_THREADS),
}
_COURSE = 1152  # states from 0 to 180 m


class _Timed(CruiseControl):
    """Notes when each state was published."""

    def __init__(self, options: Namespace) -> None:
        self.steps: list[float] = []
        self.processor: list[float] = []
        self.first = 0.0
        self._lock_step = not options.realtime_factor
        super().__init__(options, [])

    def on_step(self, t: float, seen: Observation) -> None:
        self.first = self.first or time.time()
        self.steps.append(time.perf_counter())
        self.processor.append(time.process_time())
        super().on_step(t, seen)
        if self._lock_step and self.steps[-1] - self.steps[0] > _LOCK_STEP_LIMIT:
            self.finish()


def _drive(case: str, executor: str, distance: float) -> _Timed:
    """Return the run that was driven."""
    with tempfile.TemporaryDirectory() as folder, StopSignals() as stop, ros([]):
        run = _Timed(
            Namespace(
                **dict.fromkeys(('speed', 'kp', 'ki', 'kd', 'road', 'seed', 'clock')),
                distance=distance,
                realtime_factor=0.0 if case == 'lock-step' else 1.0,
                no_bag=False,
                bag_dir=Path(folder),
                quiet=True,
                mirrors=MIRRORS if 'mirrored' in case else (),
            )
        )
        spinning: Any = _EXECUTORS[executor]()
        if 'blocked' in case:
            sleeper = Node('sleeper')
            sleeper.create_timer(0.2, lambda: time.sleep(0.1))
            spinning.add_node(sleeper)
        run.spin(stop, spinning)
        run.close()
    return run


def _figures(run: _Timed, started: float, *, lock_step: bool) -> dict[str, float]:
    taken = run.steps[-1] - run.steps[0]
    if lock_step:
        rate = (len(run.steps) - 1) / taken
        return {'steps/s': rate, 'course, s': (_COURSE - 1) / rate}
    off = np.abs(np.diff(run.steps) - 0.02) * 1e3
    p50, p99 = np.percentile(off, (50, 99))
    return {
        'jitter p99, ms': float(p99),
        'p50, ms': float(p50),
        'max, ms': float(off.max()),
        'missed': run.missed,
        'slipped': run.slipped,
        'core, %': (run.processor[-1] - run.processor[0]) / taken * 100.0,
        'start, s': run.first - started,
    }


def main() -> None:
    """Drive once and print the figures."""
    task = json.loads(sys.argv[1])
    run = _drive(task['case'], task['executor'], task['distance'])
    figures = _figures(run, task['spawned'], lock_step=task['case'] == 'lock-step')
    print(json.dumps(figures))


if __name__ == '__main__':
    main()
