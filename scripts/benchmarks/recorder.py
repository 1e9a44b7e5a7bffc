"""The recorder under a flood: messages lost and processor time, beside a run at 50 Hz.

Another process publishes, reliably and with a depth of 10,000; our recorder runs in one process
with simulator and controller. Where `ros2 bag record` is on the PATH, it meets the same flood:
with its defaults, and with a depth of 10,000. `quiet` is the run without a flood, with the
recorder and without.
"""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING, Any

from _compare import (
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

_CASES: dict[str, dict[str, Any]] = {
    'quiet': {'topics': 0, 'rate': 0, 'size': 0},
    '1 x 5,000/s of 50 B': {'topics': 1, 'rate': 5_000, 'size': 50},
    '1 x 10,000/s of 50 B': {'topics': 1, 'rate': 10_000, 'size': 50},
    '10 x 5,000/s of 50 B': {'topics': 10, 'rate': 5_000, 'size': 50},
    '20 x 500/s of 50 B': {'topics': 20, 'rate': 500, 'size': 50},
    '1 x 30/s of 1 MB': {'topics': 1, 'rate': 30, 'size': 1_000_000},
}
_BARC_SIM = 'barc_sim'
_NO_RECORDER = 'no recorder'
_ROSBAG2 = {'rosbag2': None, 'rosbag2, depth 10,000': 10_000}
QUICK = ('--repeat', '1', '--seconds', '1', '--case', '1 x 10,000/s of 50 B')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_number(parser, '--repeat', 3, 'repetitions')
    add_number(parser, '--seconds', 10, 'of each flood', 'S')
    add_case(parser, _CASES)


def measure(options: argparse.Namespace) -> Results:
    """Return the figures of each case and recorder, a list of one per repetition."""
    subjects = {case: _recorders(case) for case in options.case or _CASES}

    def measure_once(case: str, recorder: str) -> Figures:
        return run_worker(
            '_recorder.py',
            recorder=recorder,
            depth=_ROSBAG2.get(recorder),
            seconds=options.seconds,
            **_CASES[case],
        )

    return measure_in_turns(subjects, options.repeat, measure_once)


def _recorders(case: str) -> list[str]:
    """Return the recorders that this machine has for a case."""
    if case == 'quiet':
        return [_BARC_SIM, _NO_RECORDER]
    if shutil.which('ros2'):
        return [_BARC_SIM, *_ROSBAG2]
    return [_BARC_SIM]


def report(results: Results) -> str:
    """Return a table."""
    return table(results, ratio=False)
