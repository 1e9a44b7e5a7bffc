"""Several cars in one process: processor time, missed deadlines and clock slips by their number.

Each number of cars drives in real time with all topics recorded, `barc acc --cars N`, in a process
of its own, in turns. Where deadlines are missed, a process, or a machine, is too small for them.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from statistics import median
from typing import TYPE_CHECKING

from _compare import at_least_one

from barc_sim.bags.reader import info
from barc_sim.errors import UserError

if TYPE_CHECKING:
    import argparse

#: By number of cars, the figures of each repetition.
Found = dict[str, list[dict[str, float]]]
_COUNTED = {'missed': 'missed_deadlines', 'slips': 'slipped_periods', 'lost': 'lost_messages'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        '--cars', type=at_least_one, nargs='+', default=[1, 10, 20, 30, 40], metavar='N'
    )
    parser.add_argument(
        '--repeat', type=at_least_one, default=3, metavar='N', help='repetitions (3)'
    )
    parser.add_argument(
        '--distance', type=at_least_one, default=60, metavar='M', help='length of a run (60)'
    )


def measure(options: argparse.Namespace) -> Found:
    """Return the figures of each number of cars, a list of one per repetition."""
    found: Found = {str(cars): [] for cars in options.cars}
    for number in range(options.repeat):
        print(f'repetition {number + 1} of {options.repeat}', file=sys.stderr)
        for cars, figures in found.items():
            figures.append(_drive(cars, options.distance))
    return found


def _drive(cars: str, distance: int) -> dict[str, float]:
    command = [sys.executable, '-m', 'barc_sim', 'acc', '--quiet', '--cars', cars]
    with tempfile.TemporaryDirectory() as folder:
        began, before = time.monotonic(), getrusage(RUSAGE_CHILDREN)
        done = subprocess.run(  # noqa: S603 (our own)
            [*command, '--distance', str(distance), '--bag-dir', folder],
            check=False,
            capture_output=True,
            text=True,
        )
        took, after = time.monotonic() - began, getrusage(RUSAGE_CHILDREN)
        if done.returncode:
            raise UserError(f'{cars} cars failed: {done.stderr}')
        metadata = info(next(Path(folder).iterdir()))
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    counts = {name: float(metadata[key]) for name, key in _COUNTED.items()}
    return {'processor, s': processor, 'wall, s': took, **counts}


def report(found: Found) -> str:
    """Return a table of medians, with the greatest counts."""
    names = ['processor, s', 'wall, s', *_COUNTED]
    first = next(iter(found.values()))
    lines = [f'{len(first)} runs each: median times, greatest counts']
    lines.append('  '.join(['cars', *(name.rjust(12) for name in names), '    of a core']))
    for cars, runs in found.items():
        times = [median(run[name] for run in runs) for name in names[:2]]
        counts = [max(run[name] for run in runs) for name in _COUNTED]
        cells = [*(f'{value:.2f}' for value in times), *(f'{value:.0f}' for value in counts)]
        share = f'{times[0] / times[1]:.2f}'
        lines.append('  '.join([cars.rjust(4), *(c.rjust(12) for c in cells), share.rjust(13)]))
    return '\n'.join(lines)
