"""Closed loops without ROS: steps of vehicle and PID per second, over the lab's road.

The lab's own loop, with NumPy's functions for single numbers, beside `rollout`, one loop in plain
floats, and batches of thousands with NumPy and, where it is installed, with Numba; the batches on
all cores.
"""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from _compare import at_least_one

from barc_sim.errors import UserError
from barc_sim.tuning import compiled

if TYPE_CHECKING:
    import argparse

_SUBJECTS = {
    'lab': "the lab's loop, NumPy scalars",
    'objects': 'rollout, with its log',
    'single': 'one loop in plain floats',
    'numpy': 'batches with NumPy',
    'numba': 'batches with Numba',
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
    subjects = [name for name in _SUBJECTS if name != 'numba' or compiled.is_available()]
    found: Found = {subject: [] for subject in subjects}
    program = str(Path(__file__).with_name('_rollout.py'))
    for number in range(options.repeat):
        print(f'repetition {number + 1} of {options.repeat}', file=sys.stderr)
        for subject in subjects:
            task = json.dumps({'subject': subject, 'seconds': options.seconds})
            done = subprocess.run(  # noqa: S603 (our own)
                [sys.executable, program, task], capture_output=True, text=True, check=False
            )
            if done.returncode:
                raise UserError(f'{_SUBJECTS[subject]} failed: {done.stderr}')
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
    lines.append(
        f'Numba {version("numba")}' if 'numba' in found else 'Numba is not installed: .[numba]'
    )
    return '\n'.join(lines)
