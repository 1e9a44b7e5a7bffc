"""Closed loops without ROS: steps of vehicle and PID per second, over the lab's road.

The lab's own loop, with NumPy's functions for single numbers, beside `simulate` with its log, and
with noise; the scores of 100,000 gains, which are compiled where Numba is installed, on all cores,
in one thread, and those of fewer in Python; and the scores of 5,000 seeds. Likewise 10,000 runs of
the LQR, and of laps by each law of steering.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from _compare import (
    Figures,
    Results,
    add_number,
    measure_in_turns,
    run_worker,
    table,
)

if TYPE_CHECKING:
    import argparse

_SUBJECTS = {
    'simulate': 'simulate, with its log',
    'lab': "the lab's loop, NumPy scalars",
    'noise': 'simulate with noise',
    'sweep': 'sweep, on all cores',
    'one thread': 'sweep, in one thread',
    'python': 'sweep, not compiled',
    'seeds': 'sweep of seeds, with noise',
    'lqr': 'LQR, on all cores',
    'lqr python': 'LQR, not compiled',
    'laps': 'laps by the lane LQR, on all cores',
    'laps one thread': 'laps, in one thread',
    'laps python': 'laps, not compiled',
    'stanley': 'laps by Stanley',
    'pure pursuit': 'laps by pure pursuit',
    'laps seeds': 'laps of seeds, with noise',
}
QUICK = ('--repeat', '1', '--seconds', '1')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_number(parser, '--repeat', 5, 'repetitions')
    add_number(parser, '--seconds', 2, 'of each measurement', 'S')


def measure(options: argparse.Namespace) -> Results:
    """Return the figures of each subject, measured in turns, each in a process of its own."""

    def measure_once(_: str, subject: str) -> Figures:
        return run_worker('_rollout.py', subject=subject, seconds=options.seconds)

    return measure_in_turns({'closed loops': _SUBJECTS}, options.repeat, measure_once)


def report(results: Results) -> str:
    """Return a table."""
    return table(results, _SUBJECTS)
