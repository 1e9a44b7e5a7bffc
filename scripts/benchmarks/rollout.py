"""Closed loops without ROS: steps of vehicle and PID per second, over the lab's road.

The lab's own loop, with NumPy's functions for single numbers, beside `simulate` with its log, and
with noise; and the scores of many gains, which are compiled where Numba is installed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from _compare import Found, add_number, in_turns, measured, table

if TYPE_CHECKING:
    import argparse

_SUBJECTS = {
    'simulate': 'simulate, with its log',
    'lab': "the lab's loop, NumPy scalars",
    'noise': 'simulate with noise',
    'sweep': 'sweep, on all cores',
}
QUICK = ('--repeat', '1', '--seconds', '1')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_number(parser, '--repeat', 5, 'repetitions')
    add_number(parser, '--seconds', 2, 'of each measurement', 'S')


def measure(options: argparse.Namespace) -> Found:
    """Return the figures of each subject, measured in turns, each in a process of its own."""
    return in_turns(
        {'closed loops': _SUBJECTS},
        options.repeat,
        lambda _, name: measured('_rollout.py', subject=name, seconds=options.seconds),
    )


def report(found: Found) -> str:
    """Return a table."""
    return table(found, _SUBJECTS)
