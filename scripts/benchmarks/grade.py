"""A class: how long `barc grade` takes for it, confined, with reports and figures.

The submissions are right, in the form of the lab: these take the longest.
"""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.parser import whole
from barc_sim.errors import UserError

if TYPE_CHECKING:
    import argparse

_SUBMISSION = Path(__file__).parents[1] / 'submission'
#: The line of the controller that differs from student to student.
_KP_LINE = 'KP = 30.0'

Figures = dict[str, float]
QUICK = ('--count', '2')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    cores = len(os.sched_getaffinity(0))
    parser.add_argument('--count', type=whole(1), default=200, help='submissions (200)')
    parser.add_argument('--jobs', type=whole(1), default=cores, help=f'at once ({cores})')


def measure(options: argparse.Namespace) -> Figures:
    """Return the time of the class."""
    with tempfile.TemporaryDirectory(prefix='barc_sim_') as name:
        folder = Path(name)
        write_class(folder / 'class', options.count)
        command = ('-m', 'barc_sim', 'grade', 'class', '--jobs', str(options.jobs))

        start = time.perf_counter()
        process = subprocess.run(  # noqa: S603 (our own)
            [sys.executable, *command], cwd=folder, stdout=subprocess.PIPE, text=True, check=False
        )
        seconds = time.perf_counter() - start

        if process.returncode:
            raise UserError(f'grade failed: {process.stdout}')
        scores = _scores(folder / 'grades' / 'class.csv')
    return {'submissions': len(scores), 'jobs': options.jobs, 's': seconds, 'least': min(scores)}


def write_class(folder: Path, count: int) -> None:
    """Write submissions that differ in a gain."""
    for number in range(count):
        student = folder / f'student_{number:03}'
        student.mkdir(parents=True)
        for file in sorted(_SUBMISSION.glob('*.py')):
            text = file.read_text(encoding='utf-8')
            text = text.replace(_KP_LINE, f'KP = {10 + number / 10}')
            (student / file.name).write_text(text, encoding='utf-8')


def _scores(path: Path) -> list[float]:
    with path.open(encoding='utf-8') as file:
        return [float(row['score']) for row in csv.DictReader(file)]


def report(figures: Figures) -> str:
    """Return the time in all, and of one submission."""
    count = figures['submissions']
    seconds = figures['s']
    return (
        f'{count:g} submissions, {figures["jobs"]:g} at once: {seconds:.1f} s, '
        f'{seconds / count:.2f} s each; least score {figures["least"]:g}'
    )
