"""The cruise-control run: timing of its steps, missed deadlines, processor time, lock-step speed.

Each executor drives the lab's course with the recorder on, in a process of its own; once more
with all mirrors; beside a node whose callback sleeps 100 ms in every 200 ms; and in lock-step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from _compare import EXECUTORS, Found, add_case, add_number, in_turns, measured, table

if TYPE_CHECKING:
    import argparse

_CASES = ('real time', 'real time, mirrored', 'real time, blocked', 'lock-step')
QUICK = ('--repeat', '1', '--distance', '5')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_number(parser, '--repeat', 5, 'repetitions')
    add_number(parser, '--distance', 180, 'length of a run', 'M')
    add_case(parser, _CASES)


def measure(options: argparse.Namespace) -> Found:
    """Return the figures of each case and executor, a list of one per repetition."""
    return in_turns(
        dict.fromkeys(options.case or _CASES, EXECUTORS),
        options.repeat,
        lambda case, name: measured(
            '_run.py', case=case, executor=name, distance=float(options.distance)
        ),
    )


def report(found: Found) -> str:
    """Return a table."""
    return table(found, EXECUTORS)
