"""The recorder under a flood: messages lost and processor time, beside a run at 50 Hz.

Another process publishes, reliably and with a depth of 10,000; our recorder runs in one process
with simulator and controller. Where `ros2 bag record` is on the PATH, it meets the same flood:
with its defaults, and with a depth of 10,000. `quiet` is the run without a flood, with the
recorder and without.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from _compare import at_least_one

from barc_sim.errors import UserError

if TYPE_CHECKING:
    import argparse

_CASES = {
    'quiet': {'topics': 0, 'rate': 0, 'size': 0},
    '1 x 5,000/s of 50 B': {'topics': 1, 'rate': 5_000, 'size': 50},
    '1 x 10,000/s of 50 B': {'topics': 1, 'rate': 10_000, 'size': 50},
    '10 x 5,000/s of 50 B': {'topics': 10, 'rate': 5_000, 'size': 50},
    '20 x 500/s of 50 B': {'topics': 20, 'rate': 500, 'size': 50},
    '1 x 30/s of 1 MB': {'topics': 1, 'rate': 30, 'size': 1_000_000},
}
_OURS, _NONE = 'barc_sim', 'no recorder'
_ROSBAG2 = {'rosbag2': None, 'rosbag2, depth 10,000': 10_000}

#: By case and recorder, the figures of each repetition.
Found = dict[str, dict[str, list[dict[str, float]]]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        '--repeat', type=at_least_one, default=3, metavar='N', help='repetitions (3)'
    )
    parser.add_argument(
        '--seconds', type=at_least_one, default=10, metavar='S', help='of each flood (10)'
    )
    parser.add_argument(
        '--case', choices=list(_CASES), action='append', help='measure only this; can be repeated'
    )


def measure(options: argparse.Namespace) -> Found:
    """Return the figures of each case and recorder, a list of one per repetition."""
    found: Found = {case: {} for case in options.case or _CASES}
    for number in range(options.repeat):
        print(f'repetition {number + 1} of {options.repeat}', file=sys.stderr)
        for case, by_recorder in found.items():
            others = [_NONE] if case == 'quiet' else _ROSBAG2 if shutil.which('ros2') else []
            for name in (_OURS, *others):
                task = {
                    **_CASES[case],
                    'seconds': options.seconds,
                    'recorder': name,
                    'depth': _ROSBAG2.get(name),
                }
                by_recorder.setdefault(name, []).append(_in_process(task))
    return found


def _in_process(task: dict[str, object]) -> dict[str, float]:
    worker = str(Path(__file__).with_name('_recorder.py'))
    done = subprocess.run(  # noqa: S603 (our own)
        [sys.executable, worker, json.dumps(task)], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise UserError(f'{task} failed: {done.stderr}')
    return dict(json.loads(done.stdout))


def report(found: Found) -> str:
    """Return medians, with ranges in brackets."""
    lines = []
    for case, by_recorder in found.items():
        keys = list(by_recorder[_OURS][0])
        lines.append(f'{case:24}' + ''.join(f'{key:>28}' for key in keys))
        for name, runs in by_recorder.items():
            cells = (_cell([run[key] for run in runs if key in run]) for key in keys)
            lines.append(f'{name:24}' + ''.join(f'{cell:>28}' for cell in cells))
        lines.append('')
    return '\n'.join(lines)


def _cell(values: list[float]) -> str:
    if not values:
        return ''
    return f'{median(values):.4g} [{min(values):.3g}, {max(values):.3g}]'
