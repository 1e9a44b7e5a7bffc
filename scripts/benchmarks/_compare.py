"""Measurements of the same thing with different executors, each in a process of its own."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from math import floor, log10
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Mapping

EXECUTORS = {
    'ours': 'QuickExecutor',
    'single': 'SingleThreadedExecutor',
    'multi': 'MultiThreadedExecutor',
}
#: Executors in C++, which do without callback groups.
EVENTS_EXECUTORS = {'events': "Jazzy's EventsExecutor", 'kilted': "Kilted's EventsExecutor"}
TITLES = {**EXECUTORS, **EVENTS_EXECUTORS}

#: [s] for one measurement. Beside a busy thread, a stock executor may need for ever.
_LIMIT = 60.0

#: By case and executor, the figures of each repetition.
Found = dict[str, dict[str, list[dict[str, float]]]]


def at_least_one(text: str) -> int:
    """Return a number of repetitions or seconds, as given on the command line."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f'{text!r} is not a whole number from 1 on')
    return int(text)


def interleaved(
    worker: str,
    cases: list[str],
    repeat: int,
    pythons: Mapping[str, str] | None = None,
    **task: Any,  # noqa: ANN401
) -> Found:
    """Run a program of this folder for each case and executor, in turns.

    It gets the task as JSON on its command line, with the time at which it was started, and
    prints the figures as JSON. In turns, a busy machine slows all alike. `pythons` has the
    interpreter of each executor that is measured; by default this one, for rclpy's and ours.
    """
    pythons = pythons or dict.fromkeys(EXECUTORS, sys.executable)
    # The wheels of ROS set these when Python begins, once.
    wheels = ('LD_LIBRARY_PATH', '_ROS_WHEELS_BOOTSTRAP_COMPLETE')
    environment = {name: value for name, value in os.environ.items() if name not in wheels}
    found: Found = {case: {name: [] for name in pythons} for case in cases}
    program = str(Path(__file__).with_name(worker))
    for number in range(repeat):
        print(f'repetition {number + 1} of {repeat}', file=sys.stderr)
        for case in cases:
            for name, python in pythons.items():
                arguments = json.dumps(
                    {'case': case, 'executor': name, 'spawned': time.time(), **task}
                )
                try:
                    done = subprocess.run(  # noqa: S603 (our own)
                        [python, program, arguments],
                        env=environment if python != sys.executable else None,
                        capture_output=True,
                        text=True,
                        check=False,
                        timeout=_LIMIT,
                    )
                except subprocess.TimeoutExpired:
                    print(f'{case} with {TITLES[name]}: no end in {_LIMIT:g} s', file=sys.stderr)
                    continue
                if done.returncode:
                    raise UserError(f'{case} with {TITLES[name]} failed: {done.stderr}')
                found[case][name].append(json.loads(done.stdout))
    return found


def table(found: Found) -> str:
    """Return medians, with ranges in brackets, and the first figure's ratios."""
    lines = []
    for case, by_executor in found.items():
        keys = list(by_executor['ours'][0])
        runs = len(by_executor['ours'])
        rows = [[f'{case}: medians of {runs} runs', *keys, f'{keys[0]}, ratio']]
        ours = median(run[keys[0]] for run in by_executor['ours'])
        for name, figures in by_executor.items():
            if not figures:
                rows.append([TITLES[name], f'no end in {_LIMIT:g} s', *[''] * len(keys)])
                continue
            cells = [_cell([run[key] for run in figures]) for key in keys]
            ratio = ours / median(run[keys[0]] for run in figures)
            rows.append([TITLES[name], *cells, f'{ratio:.2f}'])
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        for first, *others in rows:
            cells = [cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True)]
            lines.append('  '.join([first.ljust(widths[0]), *cells]))
        lines.append('')
    return '\n'.join([*lines, 'ratio: QuickExecutor to the other'])


def _cell(values: list[float]) -> str:
    shown = [_number(value) for value in (median(values), min(values), max(values))]
    return '{} [{}, {}]'.format(*shown)


def _number(value: float) -> str:
    """Return a number with three significant digits or more, never with a power of ten."""
    decimals = max(0, 2 - floor(log10(abs(value)))) if abs(value) > 1e-3 else 0  # noqa: PLR2004
    return f'{value:,.{decimals}f}'
