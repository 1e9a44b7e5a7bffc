"""The cruise-control run: timing of its steps, missed deadlines, processor time, lock-step speed.

Each executor drives the lab's course with the recorder on, in a process of its own; once more
with all mirrors; beside a node whose callback sleeps 100 ms in every 200 ms; and in lock-step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from _compare import (
    EXECUTORS,
    Figures,
    Results,
    add_case,
    add_number,
    measure_in_turns,
    run_worker,
    table,
)

if TYPE_CHECKING:
    import argparse

_CASES = ('real time', 'real time, mirrored', 'real time, blocked', 'lock-step')
QUICK = ('--repeat', '1', '--distance', '5')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_number(parser, '--repeat', 5, 'repetitions')
    add_number(parser, '--distance', 180, 'length of a run', 'M')
    add_case(parser, _CASES)


def measure(options: argparse.Namespace) -> Results:
    """Return the figures of each case and executor, a list of one per repetition."""

    def measure_once(case: str, executor: str) -> Figures:
        return run_worker('_run.py', case=case, executor=executor, distance=float(options.distance))

    subjects = dict.fromkeys(options.case or _CASES, EXECUTORS)
    return measure_in_turns(subjects, options.repeat, measure_once)


def report(results: Results) -> str:
    """Return a table."""
    return table(results, EXECUTORS)
