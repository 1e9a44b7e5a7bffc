"""How late a 50 Hz timer is over a long time, and how much of that the machine owes.

Slices with rclpy's executors and QuickExecutor, also beside a node whose callback sleeps or
computes for 100 ms in every 200 ms, all with the recorder on, take turns with slices of a bare loop
of `time.sleep`, alone and beside a thread that does the same: it has neither ROS nor an executor in
it, and its 99 % are what the machine and Python's lock cost anybody. Of what is late by more than
1 ms, the time in which the kernel kept the thread waiting for a core is counted apart. The last
column is how far another Python thread has counted, where there is one.
"""

from __future__ import annotations

from statistics import median
from typing import TYPE_CHECKING, Any

from _compare import add_case, add_number, run_worker

from barc_sim.errors import UserError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterable

_SUBJECTS = {
    'loop free': 'bare loop',
    'single free': 'SingleThreadedExecutor',
    'multi free': 'MultiThreadedExecutor',
    'ours free': 'QuickExecutor',
    'loop sleeps': 'bare loop, beside sleep',
    'multi sleeps': 'Multi, beside sleep',
    'ours sleeps': 'Quick, beside sleep',
    'loop computes': 'bare loop, beside comp.',
    'multi computes': 'Multi, beside compute',
    'ours computes': 'Quick, beside compute',
    'loop counts': 'bare loop, and a thread',
    'multi counts': 'Multi, and a thread',
    'ours counts': 'Quick, and a thread',
}
_LIMITS = (1.0, 5.0, 15.0)  # ms
_PERCENTILES = ('p99, ms', 'less waiting')

QUICK = ('--repeat', '1', '--seconds', '1')

#: By subject, the figures that `_jitter.py` prints for each slice.
Slices = dict[str, list[dict[str, Any]]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_number(parser, '--repeat', 8, 'slices of each')
    add_number(parser, '--seconds', 30, 'of a slice', 'S')
    add_case(parser, _SUBJECTS)


def measure(options: argparse.Namespace) -> Slices:
    """Return the figures of each slice, measured in turns."""
    slices_by_subject: Slices = {subject: [] for subject in options.case or _SUBJECTS}
    for _ in range(options.repeat):
        for subject, slices in slices_by_subject.items():
            figures = run_worker('_jitter.py', subject=subject, seconds=options.seconds)
            if figures is None:
                raise UserError(f'{subject!r} has not ended in time: leave it out with --case')
            slices.append(figures)
    return slices_by_subject


def report(slices_by_subject: Slices) -> str:
    """Return a table of the numbers of late ticks, and in brackets of those the machine owes."""
    limits = [f'> {limit:g} ms' for limit in _LIMITS]
    headings = ('ticks', *limits, *_PERCENTILES, 'max, ms', 'less waiting', 'core, %', 'counts/s')
    lines = [_line('', headings)]
    for subject, slices in slices_by_subject.items():
        lines.append(_line(_SUBJECTS[subject], _cells(slices)))
    lines.append('in brackets: late only because the kernel kept the thread waiting for a core')
    return '\n'.join(lines)


def _line(title: str, cells: Iterable[str]) -> str:
    return f'{title:24}' + ''.join(f'{cell:>20}' for cell in cells)


def _cells(slices: list[dict[str, Any]]) -> list[str]:
    lateness = []  # ms
    without_waits = []  # ms
    for part in slices:
        for late, wait in part['late']:
            lateness.append(late)
            without_waits.append(late - wait)

    cells = [str(sum(part['ticks'] for part in slices))]
    for limit in _LIMITS:
        count = sum(late > limit for late in lateness)
        count_without_waits = sum(late > limit for late in without_waits)
        cells.append(f'{count} ({count - count_without_waits})')

    cells += [f'{_median(slices, name):.3g}' for name in _PERCENTILES]
    cells.append(f'{max(lateness, default=0.0):.3g}')
    cells.append(f'{max(without_waits, default=0.0):.3g}')
    cells.append(f'{_median(slices, "core"):.2f}')
    cells.append(f'{_median(slices, "counted"):.3g}')
    return cells


def _median(slices: list[dict[str, Any]], name: str) -> float:
    return float(median(part[name] for part in slices))
