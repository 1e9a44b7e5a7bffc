"""Measurements of the same thing with different executors, each in a process of its own."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from typing import Any

from barc_sim.errors import UserError

EXECUTORS = {
    'ours': 'QuickExecutor',
    'single': 'SingleThreadedExecutor',
    'multi': 'MultiThreadedExecutor',
}

#: By case and executor, the figures of each repetition.
Found = dict[str, dict[str, list[dict[str, float]]]]


def at_least_one(text: str) -> int:
    """Return a number of repetitions or seconds, as given on the command line."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f'{text!r} is not a whole number from 1 on')
    return int(text)


def interleaved(worker: str, cases: list[str], repeat: int, **task: Any) -> Found:  # noqa: ANN401
    """Run a program of this folder for each case and executor, in turns.

    It gets the task as JSON on its command line, with the time at which it was started, and
    prints the figures as JSON. In turns, the
    machine's moods meet all alike.
    """
    found: Found = {case: {name: [] for name in EXECUTORS} for case in cases}
    program = str(Path(__file__).with_name(worker))
    for number in range(repeat):
        print(f'repetition {number + 1} of {repeat}', file=sys.stderr)
        for case in cases:
            for name, title in EXECUTORS.items():
                arguments = json.dumps(
                    {'case': case, 'executor': name, 'spawned': time.time(), **task}
                )
                done = subprocess.run(  # noqa: S603 (our own)
                    [sys.executable, program, arguments],
                    capture_output=True,
                    text=True,
                    check=False,
                )
                if done.returncode:
                    raise UserError(f'{case} with {title} failed: {done.stderr}')
                found[case][name].append(json.loads(done.stdout))
    return found


def table(found: Found) -> str:
    """Return medians, with ranges in brackets, and the first figure's ratios."""
    lines = []
    for case, by_executor in found.items():
        keys = list(by_executor['ours'][0])
        lines.append(f'{case:24}' + ''.join(f'{key:>28}' for key in keys))
        for name, runs in by_executor.items():
            cells = (_cell([run[key] for run in runs]) for key in keys)
            lines.append(f'{EXECUTORS[name]:24}' + ''.join(f'{cell:>28}' for cell in cells))
        ours, *others = ([run[keys[0]] for run in runs] for runs in by_executor.values())
        for title, values in zip(list(EXECUTORS.values())[1:], others, strict=True):
            ratio = median(ours) / median(values)
            lines.append(f'{keys[0]}: QuickExecutor / {title} = {ratio:.3g}')
        lines.append('')
    return '\n'.join(lines)


def _cell(values: list[float]) -> str:
    return f'{median(values):.4g} [{min(values):.3g}, {max(values):.3g}]'
