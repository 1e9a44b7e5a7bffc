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
from typing import TYPE_CHECKING

from _compare import (
    Figures,
    Results,
    add_number,
    measure_in_turns,
    table,
)

from barc_sim.bags.reader import info
from barc_sim.cli.parser import whole
from barc_sim.errors import UserError

if TYPE_CHECKING:
    import argparse

_COUNTS = {'missed': 'missed_deadlines', 'slips': 'slipped_periods', 'lost': 'lost_messages'}
QUICK = ('--repeat', '1', '--distance', '2', '--cars', '2')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        '--cars', type=whole(1), nargs='+', default=[1, 10, 20, 30, 40], metavar='N'
    )
    add_number(parser, '--repeat', 3, 'repetitions')
    add_number(parser, '--distance', 60, 'length of a run', 'M')


def measure(options: argparse.Namespace) -> Results:
    """Return the figures of each number of cars, a list of one per repetition."""

    def measure_once(_: str, cars: str) -> Figures:
        return _drive(cars, options.distance)

    return measure_in_turns({'cars': map(str, options.cars)}, options.repeat, measure_once)


def _drive(cars: str, distance: int) -> dict[str, float]:
    command = [sys.executable, '-m', 'barc_sim', 'acc', '--quiet', '--cars', cars]
    with tempfile.TemporaryDirectory() as folder:
        start = time.monotonic()
        before = getrusage(RUSAGE_CHILDREN)
        process = subprocess.run(  # noqa: S603 (our own)
            [*command, '--distance', str(distance), '--bag-dir', folder],
            check=False,
            capture_output=True,
            text=True,
        )
        after = getrusage(RUSAGE_CHILDREN)
        seconds = time.monotonic() - start

        if process.returncode:
            raise UserError(f'{cars} cars failed: {process.stderr}')
        metadata = info(next(Path(folder).iterdir()))

    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    counts = {name: float(metadata[key]) for name, key in _COUNTS.items()}
    return {
        'of a core': processor / seconds,
        'processor, s': processor,
        'wall, s': seconds,
        **counts,
    }


def report(results: Results) -> str:
    """Return a table."""
    return table(results, ratio=False)
