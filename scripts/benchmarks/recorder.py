"""The recorder under a flood: messages lost and processor time, beside a run at 50 Hz.

Another process publishes, reliably and with a depth of 10,000; our recorder runs in one process
with simulator and controller. Where `ros2 bag record` is on the PATH, it meets the same flood:
with its defaults, and with a depth of 10,000. `quiet` is the run without a flood, with the
recorder and without.
"""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING, Any

from _compare import Found, add_case, add_number, in_turns, measured, table

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
_OURS = 'barc_sim'
_NONE = 'no recorder'
_ROSBAG2 = {'rosbag2': None, 'rosbag2, depth 10,000': 10_000}
QUICK = ('--repeat', '1', '--seconds', '1', '--case', '1 x 10,000/s of 50 B')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_number(parser, '--repeat', 3, 'repetitions')
    add_number(parser, '--seconds', 10, 'of each flood', 'S')
    add_case(parser, _CASES)


def measure(options: argparse.Namespace) -> Found:
    """Return the figures of each case and recorder, a list of one per repetition."""
    rosbag2 = _ROSBAG2 if shutil.which('ros2') else ()
    return in_turns(
        {
            case: (_OURS, *([_NONE] if case == 'quiet' else rosbag2))
            for case in options.case or _CASES
        },
        options.repeat,
        lambda case, name: measured(
            '_recorder.py',
            recorder=name,
            depth=_ROSBAG2.get(name),
            seconds=options.seconds,
            **_CASES[case],
        ),
    )


def report(found: Found) -> str:
    """Return a table."""
    return table(found, ratio=False)
