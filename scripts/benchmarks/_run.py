"""One cruise-control run for `run.py`: a task as JSON on the command line, its figures printed."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from typing import Any

from _timed import TimedRun
from rclpy import executors
from rclpy.node import Node

from barc_sim.cli.process import StopSignals
from barc_sim.ros.executor import QuickExecutor
from barc_sim.ros.process import NUM_THREADS, ros

#: [s] A stock executor may need minutes for a course in lock-step: it is stopped here.
_LOCK_STEP_LIMIT = 10.0
_EXECUTORS = {
    'ours': lambda: QuickExecutor(num_threads=NUM_THREADS),
    'single': executors.SingleThreadedExecutor,
    'multi': lambda: executors.MultiThreadedExecutor(num_threads=NUM_THREADS),
}
_COURSE = 1152  # states from 0 to 180 m


class _Run(TimedRun):
    """Ends early where a lock-step course would take minutes."""

    def show(self, *status: object) -> None:
        super().show(*status)
        if self.in_lock_step and self.steps[-1] - self.steps[0] > _LOCK_STEP_LIMIT:
            self.run.finish()


def _drive(case: str, executor: str, distance: float) -> _Run:
    """Return the run that was driven."""
    with tempfile.TemporaryDirectory() as folder, StopSignals() as stop, ros([]):
        options = ['--distance', str(distance), '--bag-dir', folder]
        if case == 'lock-step':
            options += ['--realtime-factor', 'max']
        if 'mirrored' in case:
            options += ['--mirrors']
        run = _Run(*options)
        spinning: Any = _EXECUTORS[executor]()
        if 'blocked' in case:
            sleeper = Node('sleeper')
            sleeper.create_timer(0.2, lambda: time.sleep(0.1))
            spinning.add_node(sleeper)
        run.spin(stop, spinning)
    return run


def _figures(run: _Run, started: float, *, lock_step: bool) -> dict[str, float]:
    taken = run.steps[-1] - run.steps[0]
    if lock_step:
        rate = (len(run.steps) - 1) / taken
        return {'steps/s': rate, 'course, s': (_COURSE - 1) / rate}
    return {**run.timing(), 'start, s': run.first - started}


def main() -> None:
    """Drive once and print the figures."""
    task = json.loads(sys.argv[1])
    run = _drive(task['case'], task['executor'], task['distance'])
    figures = _figures(run, task['spawned'], lock_step=task['case'] == 'lock-step')
    print(json.dumps(figures))


if __name__ == '__main__':
    main()
