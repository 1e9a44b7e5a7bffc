"""The cruise-control run: timing of its steps, missed deadlines, processor time, lock-step speed.

Each executor drives the lab's course with the recorder on, in a process of its own; once more
beside a node whose callback sleeps 100 ms in every 200 ms; and once in lock-step.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from argparse import Namespace
from pathlib import Path
from statistics import median
from typing import Any

#: [s] Stock executors may need minutes for a course in lock-step: it is stopped here.
_LOCK_STEP_LIMIT = 10.0
_EXECUTORS = ('ours', 'single', 'multi')
_NAMES = {
    'ours': 'QuickExecutor',
    'single': 'SingleThreadedExecutor',
    'multi': 'MultiThreadedExecutor',
}
_CASES = ('real time', 'real time, blocked', 'lock-step')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('--repeat', type=int, default=5, metavar='N', help='repetitions (5)')
    parser.add_argument(
        '--distance', type=float, default=180.0, metavar='M', help='length of a run (180)'
    )


def measure(options: Namespace) -> dict[str, Any]:
    """Return the figures of each case and executor, a list of one per repetition."""
    found: dict[str, Any] = {case: {name: [] for name in _EXECUTORS} for case in _CASES}
    for _ in range(options.repeat):
        for case in _CASES:
            for name in _EXECUTORS:  # interleaved: the machine's moods meet all alike
                task = {'case': case, 'executor': name, 'distance': options.distance}
                found[case][name].append(_in_process(task))
    return found


def _in_process(task: dict[str, Any]) -> dict[str, float]:
    command = [sys.executable, __file__, json.dumps({**task, 'spawned': time.time()})]
    done = subprocess.run(  # noqa: S603 (this file)
        command, capture_output=True, text=True, check=True
    )
    return dict(json.loads(done.stdout))


def report(found: dict[str, Any]) -> str:
    """Return a table of medians, and ranges in brackets."""
    lines = []
    for case, by_executor in found.items():
        lines.append(case)
        keys = list(by_executor['ours'][0])
        lines.append(''.join(f'{key:>24}' for key in ('', *keys)))
        for name, runs in by_executor.items():
            cells = [_cell([run[key] for run in runs]) for key in keys]
            lines.append(''.join(f'{cell:>24}' for cell in (_NAMES[name], *cells)))
        for name in _EXECUTORS[1:]:
            ratio = _median(by_executor[name], keys[0]) / _median(by_executor['ours'], keys[0])
            lines.append(f'{keys[0]}: {_NAMES[name]} / QuickExecutor = {ratio:.3g}')
        lines.append('')
    return '\n'.join(lines)


def _median(runs: list[dict[str, float]], key: str) -> float:
    return median(run[key] for run in runs)


def _cell(values: list[float]) -> str:
    return f'{median(values):.4g} [{min(values):.3g}, {max(values):.3g}]'


def _work(task: dict[str, Any]) -> dict[str, float]:
    """Drive once, in this process; return the figures."""
    import numpy as np  # noqa: PLC0415 (the worker only)
    from rclpy import executors  # noqa: PLC0415
    from rclpy.node import Node  # noqa: PLC0415

    from barc_sim.composition import CruiseControl  # noqa: PLC0415
    from barc_sim.executor import QuickExecutor  # noqa: PLC0415
    from barc_sim.process import NUM_THREADS, ros  # noqa: PLC0415
    from barc_sim.signals import StopSignals  # noqa: PLC0415

    steps: list[float] = []
    processor: list[float] = []
    first: list[float] = []

    class Timed(CruiseControl):
        def on_step(self, t: float, seen: Any) -> None:  # noqa: ANN401
            steps.append(time.perf_counter())
            processor.append(time.process_time())
            if not first:
                first.append(time.time())
            super().on_step(t, seen)
            if lock_step and steps[-1] - steps[0] > _LOCK_STEP_LIMIT:
                self.finish()

    lock_step = task['case'] == 'lock-step'
    with tempfile.TemporaryDirectory() as folder, ros([]), StopSignals() as stop:
        run = Timed(
            Namespace(
                **dict.fromkeys(('speed', 'kp', 'ki', 'kd', 'road', 'seed')),
                distance=task['distance'],
                realtime_factor=0.0 if lock_step else 1.0,
                no_bag=False,
                bag_dir=Path(folder),
                quiet=True,
            ),
            [],
        )
        executor: Any = {
            'ours': lambda: QuickExecutor(num_threads=NUM_THREADS),
            'single': executors.SingleThreadedExecutor,
            'multi': lambda: executors.MultiThreadedExecutor(num_threads=NUM_THREADS),
        }[task['executor']]()
        if 'blocked' in task['case']:
            sleeper = Node('sleeper')
            sleeper.create_timer(0.2, lambda: time.sleep(0.1))
            executor.add_node(sleeper)
        run.spin(stop, executor)
        missed, slipped = run.missed, run.slipped
        run.close()
    taken = steps[-1] - steps[0]
    share = (processor[-1] - processor[0]) / taken * 100.0
    if lock_step:
        return {
            'ms/step': taken / (len(steps) - 1) * 1e3,
            'steps': len(steps),
            'course, s': taken / (len(steps) - 1) * 1151,
        }
    off = np.abs(np.diff(steps) - 0.02) * 1e3
    return {
        'jitter p99, ms': float(np.percentile(off, 99)),
        'p50, ms': float(np.percentile(off, 50)),
        'max, ms': float(off.max()),
        'missed': missed,
        'slipped': slipped,
        'core, %': share,
        'start, s': first[0] - task['spawned'],
    }


if __name__ == '__main__':
    print(json.dumps(_work(json.loads(sys.argv[1]))))
