"""Closed loops without ROS: steps of vehicle and PID per second, over the lab's road.

The lab's own loop, with NumPy's functions for single numbers, beside `simulate` with its log (and
with noise), one loop without a log, and batches of thousands with NumPy on all cores.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from _compare import at_least_one

from barc_sim.errors import UserError

if TYPE_CHECKING:
    import argparse

_SUBJECTS = {
    'lab': "the lab's loop, NumPy scalars",
    'simulate': 'simulate, with its log',
    'general': 'simulate with noise',
    'single': 'one loop without a log',
    'numpy': 'batches with NumPy',
}

#: By subject, the steps per second of each repetition.
Found = dict[str, list[float]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        '--repeat', type=at_least_one, default=5, metavar='N', help='repetitions (5)'
    )
    parser.add_argument(
        '--seconds', type=at_least_one, default=2, metavar='S', help='of each measurement (2)'
    )


def measure(options: argparse.Namespace) -> Found:
    """Return the figures of each subject, measured in turns, each in a process of its own."""
    found: Found = {subject: [] for subject in _SUBJECTS}
    program = str(Path(__file__).with_name('_rollout.py'))
    for number in range(options.repeat):
        print(f'repetition {number + 1} of {options.repeat}', file=sys.stderr)
        for subject, title in _SUBJECTS.items():
            task = json.dumps({'subject': subject, 'seconds': options.seconds})
            done = subprocess.run(  # noqa: S603 (our own)
                [sys.executable, program, task], capture_output=True, text=True, check=False
            )
            if done.returncode:
                raise UserError(f'{title} failed: {done.stderr}')
            found[subject].append(json.loads(done.stdout)['steps_per_s'])
    return found


def report(found: Found) -> str:
    """Return a table: medians, ranges in brackets, and ratios to the lab's loop."""
    slowest = median(found['lab'])
    lines = [f'{"":32}{"steps/s":>14}{"":>30}{"ratio":>8}']
    for subject, rates in found.items():
        spread = f'[{min(rates):,.0f}, {max(rates):,.0f}]'
        ratio = median(rates) / slowest
        lines.append(f'{_SUBJECTS[subject]:32}{median(rates):>14,.0f}{spread:>30}{ratio:>8.1f}')
    return '\n'.join(lines)
