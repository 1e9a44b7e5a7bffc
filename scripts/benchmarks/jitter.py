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

from _compare import add_case, add_number, measured

if TYPE_CHECKING:
    import argparse

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
_SHARES = ('p99, ms', 'less waiting')

QUICK = ('--repeat', '1', '--seconds', '1')

#: By subject, what `_jitter.py` found in each slice.
Found = dict[str, list[dict[str, Any]]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_number(parser, '--repeat', 8, 'slices of each')
    add_number(parser, '--seconds', 30, 'of a slice', 'S')
    add_case(parser, _SUBJECTS)


def measure(options: argparse.Namespace) -> Found:
    """Return what each slice found."""
    found: Found = {subject: [] for subject in options.case or _SUBJECTS}
    for _ in range(options.repeat):
        for subject, slices in found.items():
            slices.append(measured('_jitter.py', subject=subject, seconds=options.seconds))
    return found


def report(found: Found) -> str:
    """Return a table of the numbers of late ticks, and in brackets of those the machine owes."""
    limits = [f'> {limit:g} ms' for limit in _LIMITS]
    heads = ('ticks', *limits, *_SHARES, 'max, ms', 'less waiting', 'core, %', 'counts/s')
    lines = [f'{"":24}' + ''.join(f'{head:>20}' for head in heads)]
    for subject, slices in found.items():
        late = [each for part in slices for each in part['late']]
        cells = [str(sum(part['ticks'] for part in slices))]
        for limit in _LIMITS:
            count = sum(ms > limit for ms, _ in late)
            left = sum(ms - waited > limit for ms, waited in late)
            cells.append(f'{count} ({count - left})')
        cells += [f'{median(part[name] for part in slices):.3g}' for name in _SHARES]
        cells.append(f'{max((ms for ms, _ in late), default=0.0):.3g}')
        cells.append(f'{max((ms - waited for ms, waited in late), default=0.0):.3g}')
        cells.append(f'{median(part["core"] for part in slices):.2f}')
        cells.append(f'{median(part["counted"] for part in slices):.3g}')
        lines.append(f'{_SUBJECTS[subject]:24}' + ''.join(f'{cell:>20}' for cell in cells))
    lines.append('in brackets: late only because the kernel kept the thread waiting for a core')
    return '\n'.join(lines)
