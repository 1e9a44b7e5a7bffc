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
    from collections.abc import Callable, Iterable, Mapping, Sequence

EXECUTORS = {
    'ours': 'QuickExecutor',
    'single': 'SingleThreadedExecutor',
    'multi': 'MultiThreadedExecutor',
}
#: Executors in C++, which do without callback groups.
EVENTS_EXECUTORS = {'events': "Jazzy's EventsExecutor", 'kilted': "Kilted's EventsExecutor"}

#: [s] for one measurement. Beside a busy thread, a stock executor may need for ever.
_TIMEOUT = 60.0
#: The wheels of ROS set these variables when Python begins, once.
_VARIABLES_OF_WHEELS = ('LD_LIBRARY_PATH', '_ROS_WHEELS_BOOTSTRAP_COMPLETE')

#: The figures of one measurement, by name; None where it did not end.
Figures = dict[str, float] | None
#: By case and subject, the figures of each repetition.
Results = dict[str, dict[str, list[Figures]]]


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


def measure_in_turns(
    subjects: Mapping[str, Iterable[str]], repeat: int, measure: Callable[[str, str], Figures]
) -> Results:
    """Measure the subjects of each case in turns, so that a busy machine slows all alike.

    Parameters
    ----------
    subjects
        The names of the subjects, by case.
    repeat
        How many times each subject is measured.
    measure
        Takes a case and a subject; returns the figures of one measurement.
    """
    results: Results = {}
    for case, names in subjects.items():
        results[case] = {name: [] for name in names}

    for number in range(repeat):
        print(f'repetition {number + 1} of {repeat}', file=sys.stderr)
        for case, runs_by_subject in results.items():
            for name, runs in runs_by_subject.items():
                runs.append(measure(case, name))
    return results


def run_worker(program: str, python: str = sys.executable, **task: Any) -> dict[str, Any] | None:  # noqa: ANN401
    """Run a program of this folder on a task.

    The program gets the task as JSON on its command line, with the time at which it was started.

    Returns
    -------
    dict or None
        The figures, which the program prints as JSON; None if it does not end.

    Raises
    ------
    UserError
        The program fails.
    """
    environment = None
    if python != sys.executable:
        environment = {
            name: value for name, value in os.environ.items() if name not in _VARIABLES_OF_WHEELS
        }

    words = json.dumps({'spawned': time.time(), **task})
    try:
        process = subprocess.run(  # noqa: S603 (our own)
            [python, str(Path(__file__).with_name(program)), words],
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=_TIMEOUT + task.get('seconds', 0),
        )
    except subprocess.TimeoutExpired:
        return None

    if process.returncode:
        raise UserError(f'{task} failed: {process.stderr}')
    figures: dict[str, Any] = json.loads(process.stdout)
    return figures


def table(results: Results, titles: Mapping[str, str] | None = None, *, ratio: bool = True) -> str:
    """Return medians, with ranges in brackets, and the ratio to the first subject's.

    Parameters
    ----------
    results
        Of `measure_in_turns`.
    titles
        What a subject is called in the table; default: its name.
    ratio
        Whether the last column is the ratio of the first figure.
    """
    lines = []
    count = 0
    for case, runs_by_subject in results.items():
        lines += _align(_rows(case, runs_by_subject, titles or {}, ratio=ratio))
        lines.append('')
        count = max(count, *map(len, runs_by_subject.values()))

    note = f'medians of {count} runs [minimum, maximum]'
    if ratio:
        note += '; ratio: the first to the other'
    return '\n'.join([*lines, note])


def _rows(
    case: str,
    runs_by_subject: Mapping[str, Sequence[Figures]],
    titles: Mapping[str, str],
    *,
    ratio: bool,
) -> list[list[str]]:
    """Return the heading of a case, and a row for each subject, all of the same length."""
    ended_runs = {name: _ended_runs(runs) for name, runs in runs_by_subject.items()}
    keys: list[str] = []
    for runs in ended_runs.values():
        if runs:
            keys = list(runs[0])
            break

    first_runs = next(iter(ended_runs.values()))
    has_ratio = ratio and bool(first_runs)
    heading = [case, *keys]
    if has_ratio:
        heading.append(f'{keys[0]}, ratio')

    rows = [heading]
    for name, runs in ended_runs.items():
        row = [titles.get(name, name)]
        if runs:
            row += [_cell(runs, key) for key in keys]
        else:
            row.append('no end')
        if has_ratio and runs:
            row.append(f'{_median(first_runs, keys[0]) / _median(runs, keys[0]):.2f}')
        rows.append(row)

    columns = max(map(len, rows))
    return [row + [''] * (columns - len(row)) for row in rows]


def _ended_runs(runs: Iterable[Figures]) -> list[dict[str, float]]:
    return [figures for figures in runs if figures]


def _median(runs: Iterable[Mapping[str, float]], key: str) -> float:
    return median(figures[key] for figures in runs)


def _cell(runs: Iterable[Mapping[str, float]], key: str) -> str:
    values = [figures[key] for figures in runs if key in figures]
    if not values:
        return ''
    return f'{_number(median(values))} [{_number(min(values))}, {_number(max(values))}]'


def _number(value: float) -> str:
    """Return a number with three significant digits or more, never with a power of ten."""
    decimals = 0
    if abs(value) > 1e-3:  # noqa: PLR2004 (smaller ones count as zero)
        decimals = max(0, 2 - floor(log10(abs(value))))
    return f'{value:,.{decimals}f}'


def _align(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return a line for each row: the first column to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = [cell.rjust(width) for cell, width in zip(row, widths, strict=True)]
        cells[0] = row[0].ljust(widths[0])
        lines.append('  '.join(cells).rstrip())
    return lines
