"""The cruise-control run: timing of its steps, missed deadlines, processor time, lock-step speed.

Each executor drives the lab's course with the recorder on, in a process of its own; once more
with all mirrors; beside a node whose callback sleeps 100 ms in every 200 ms; and in lock-step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from _compare import Found, at_least_one, interleaved, table

if TYPE_CHECKING:
    import argparse

_CASES = ('real time', 'real time, mirrored', 'real time, blocked', 'lock-step')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        '--repeat', type=at_least_one, default=5, metavar='N', help='repetitions (5)'
    )
    parser.add_argument(
        '--distance', type=at_least_one, default=180, metavar='M', help='length of a run (180)'
    )
    parser.add_argument(
        '--case', choices=_CASES, action='append', help='measure only this; can be repeated'
    )


def measure(options: argparse.Namespace) -> Found:
    """Return the figures of each case and executor, a list of one per repetition."""
    cases = options.case or list(_CASES)
    return interleaved('_run.py', cases, options.repeat, distance=float(options.distance))


def report(found: Found) -> str:
    """Return a table."""
    return table(found)
