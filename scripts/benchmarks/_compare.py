"""Measurements of several subjects in turns, each in a process of its own, and their table."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from math import floor, log10
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from barc_sim.cli.parser import whole
from barc_sim.errors import UserError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterable, Mapping

EXECUTORS = {
    'ours': 'QuickExecutor',
    'single': 'SingleThreadedExecutor',
    'multi': 'MultiThreadedExecutor',
}
#: Executors in C++, which do without callback groups.
EVENTS_EXECUTORS = {'events': "Jazzy's EventsExecutor", 'kilted': "Kilted's EventsExecutor"}

#: [s] for one measurement. Beside a busy thread, a stock executor may need for ever.
_LIMIT = 60.0

#: The figures of one measurement, by name; None where it did not end.
Figures = dict[str, float] | None
#: By case and subject, the figures of each repetition.
Found = dict[str, dict[str, list[Figures]]]


def add_number(
    parser: argparse.ArgumentParser, option: str, default: int, meaning: str, metavar: str = 'N'
) -> None:
    """Declare an option that takes a whole number from 1 on."""
    about = f'{meaning} ({default})'
    parser.add_argument(option, type=whole(1), default=default, metavar=metavar, help=about)


def add_case(parser: argparse.ArgumentParser, cases: Iterable[str]) -> None:
    """Declare the option `--case`."""
    about = 'measure only this; can be repeated'
    parser.add_argument('--case', choices=list(cases), action='append', help=about)


def in_turns(
    subjects: Mapping[str, Iterable[str]], repeat: int, measure: Callable[[str, str], Figures]
) -> Found:
    """Measure the subjects of each case in turns, so that a busy machine slows all alike."""
    found: Found = {case: {name: [] for name in names} for case, names in subjects.items()}
    for number in range(repeat):
        print(f'repetition {number + 1} of {repeat}', file=sys.stderr)
        for case, by_subject in found.items():
            for name, runs in by_subject.items():
                runs.append(measure(case, name))
    return found


def measured(worker: str, python: str = sys.executable, **task: Any) -> Any:  # noqa: ANN401
    """Run a program of this folder; return what it prints as JSON, or None if it does not end.

    It gets the task as JSON on its command line, with the time at which it was started.
    """
    # The wheels of ROS set these when Python begins, once.
    wheels = ('LD_LIBRARY_PATH', '_ROS_WHEELS_BOOTSTRAP_COMPLETE')
    environment = {name: value for name, value in os.environ.items() if name not in wheels}
    program = str(Path(__file__).with_name(worker))
    try:
        done = subprocess.run(  # noqa: S603 (our own)
            [python, program, json.dumps({'spawned': time.time(), **task})],
            env=environment if python != sys.executable else None,
            capture_output=True,
            text=True,
            check=False,
            timeout=_LIMIT + task.get('seconds', 0),
        )
    except subprocess.TimeoutExpired:
        return None
    if done.returncode:
        raise UserError(f'{task} failed: {done.stderr}')
    return json.loads(done.stdout)


def table(found: Found, titles: Mapping[str, str] | None = None, *, ratio: bool = True) -> str:
    """Return medians, with ranges in brackets, and the ratio to the first subject's."""
    titles = titles or {}
    lines = []
    for case, by_subject in found.items():
        first = [each for each in next(iter(by_subject.values())) if each]
        keys = list(first[0]) if first else []
        rows = [[case, *keys, *([f'{keys[0]}, ratio'] if ratio and keys else [])]]
        for name, runs in by_subject.items():
            ended = [run for run in runs if run]
            cells = [_cell([run[key] for run in ended if key in run]) for key in keys]
            if ratio and ended and first:
                base, other = (median(run[keys[0]] for run in each) for each in (first, ended))
                cells.append(f'{base / other:.2f}')
            rows.append([titles.get(name, name), *(cells if ended else ['no end'])])
        width = len(rows[0])
        rows = [[*row, *[''] * (width - len(row))] for row in rows]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        for head, *others in rows:
            cells = [cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True)]
            lines.append('  '.join([head.ljust(widths[0]), *cells]).rstrip())
        lines.append('')
    count = max(len(runs) for by_subject in found.values() for runs in by_subject.values())
    last = f'medians of {count} runs [minimum, maximum]'
    return '\n'.join([*lines, f'{last}; ratio: the first to the other' if ratio else last])


def _cell(values: list[float]) -> str:
    if not values:
        return ''
    shown = [_number(value) for value in (median(values), min(values), max(values))]
    return '{} [{}, {}]'.format(*shown)


def _number(value: float) -> str:
    """Return a number with three significant digits or more, never with a power of ten."""
    decimals = max(0, 2 - floor(log10(abs(value)))) if abs(value) > 1e-3 else 0  # noqa: PLR2004
    return f'{value:,.{decimals}f}'
