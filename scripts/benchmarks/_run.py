"""One run for `run.py`: its task is JSON on the command line, and so are its figures."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from typing import Any

from _timed import TimedRun
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node

from barc_sim.cli.process import StopSignals
from barc_sim.ros.executor import QuickExecutor
from barc_sim.ros.process import NUM_THREADS, ros

#: [s] A stock executor may need minutes for a course in lock-step: it is stopped here.
_LOCK_STEP_LIMIT = 10.0
_COURSE = 1152  # states from 0 to 180 m


class _ShortRun(TimedRun):
    """Ends early where a lock-step course would take minutes."""

    def show(self, *status: object) -> None:
        super().show(*status)
        if self.in_lock_step and self.steps[-1] - self.steps[0] > _LOCK_STEP_LIMIT:
            self.run.finish()


def _drive(case: str, executor_name: str, distance: float) -> _ShortRun:
    """Return the run after its end."""
    with tempfile.TemporaryDirectory() as folder, StopSignals() as stop, ros([]):
        options = ['--distance', str(distance), '--bag-dir', folder]
        if case == 'lock-step':
            options += ['--realtime-factor', 'max']
        if 'mirrored' in case:
            options += ['--mirrors']
        run = _ShortRun(*options)

        executor = _executor(executor_name)
        if 'blocked' in case:
            sleeper = Node('sleeper')
            sleeper.create_timer(0.2, _sleep)
            executor.add_node(sleeper)
        run.spin(stop, executor)
    return run


def _executor(name: str) -> Any:  # noqa: ANN401 (any executor)
    if name == 'single':
        return SingleThreadedExecutor()
    if name == 'multi':
        return MultiThreadedExecutor(num_threads=NUM_THREADS)
    return QuickExecutor(num_threads=NUM_THREADS)


def _sleep() -> None:
    time.sleep(0.1)


def _figures(run: _ShortRun, start: float) -> dict[str, float]:
    """Return the figures of a run whose process was started at `start` [s]."""
    if run.in_lock_step:
        rate = (len(run.steps) - 1) / (run.steps[-1] - run.steps[0])
        return {'steps/s': rate, 'course, s': (_COURSE - 1) / rate}
    return {**run.timing(), 'start, s': run.first_state - start}


def main() -> None:
    """Drive once and print the figures."""
    task = json.loads(sys.argv[1])
    run = _drive(task['case'], task['executor'], task['distance'])
    print(json.dumps(_figures(run, task['spawned'])))


if __name__ == '__main__':
    main()
