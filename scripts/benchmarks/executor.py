"""The executor beside rclpy's own: round trips per second, a timer's jitter, processor time.

Ping-pong: two nodes answer one another as fast as they can, once more beside a busy Python
thread, across two processes, and with the recorder on. Where Python 3.12 can be had, Kilted's
EventsExecutor is measured, too, in a virtual environment of its own that is made once.
Jitter: a 50 Hz timer publishes on seven topics, beside the recorder and a node whose callback
sleeps 100 ms in every 200 ms.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from _compare import EXECUTORS, TITLES, Found, at_least_one, interleaved, table

if TYPE_CHECKING:
    import argparse

    from matplotlib.figure import Figure

_PING_PONG = ('ping-pong', 'ping-pong, busy thread')
_TWO_PROCESSES = 'ping-pong, two processes'  # in which the C++ executors do not end
_CASES = (*_PING_PONG, _TWO_PROCESSES, 'ping-pong, recorded', 'jitter')
_KILTED = Path(__file__).parents[2] / '.setup' / 'kilted'
_PACKAGES = ('ros-kilted-rclpy', 'ros-kilted-std-msgs', 'ros-kilted-rmw-fastrtps-cpp', 'numpy')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        '--repeat', type=at_least_one, default=5, metavar='N', help='repetitions (5)'
    )
    parser.add_argument(
        '--seconds', type=at_least_one, default=5, metavar='S', help='of each measurement (5)'
    )
    parser.add_argument(
        '--case', choices=_CASES, action='append', help='measure only this; can be repeated'
    )


def measure(options: argparse.Namespace) -> Found:
    """Return the figures of each case and executor, a list of one per repetition."""
    cases = options.case or list(_CASES)
    pythons = dict.fromkeys([*EXECUTORS, 'events'], sys.executable)
    if kilted := _kilted():
        pythons['kilted'] = kilted
    plain = [case for case in cases if case in _PING_PONG]
    found: Found = {}
    if plain:
        found = interleaved(
            '_ping_pong.py', plain, options.repeat, pythons, seconds=options.seconds
        )
    if _TWO_PROCESSES in cases:
        found |= interleaved(
            '_ping_pong.py', [_TWO_PROCESSES], options.repeat, seconds=options.seconds
        )
    if others := [case for case in cases if case not in (*plain, _TWO_PROCESSES)]:
        found |= interleaved('_executor.py', others, options.repeat, seconds=options.seconds)
    return found


def _kilted() -> str | None:
    """Return the Python of an environment with Kilted's rclpy; None where there is none."""
    python = _KILTED / 'bin' / 'python'
    # pyenv's command is there for versions that are not chosen, too, and does not work then.
    installed = Path('~/.pyenv/versions').expanduser().glob('3.12.*/bin/python')
    base = next(map(str, installed), None) or shutil.which('python3.12')
    if not python.exists() and base:
        print("making an environment with Kilted's rclpy", file=sys.stderr)
        made = subprocess.run([base, '-m', 'venv', str(_KILTED)], check=False)  # noqa: S603
        command = [str(python), '-m', 'pip', 'install', '--quiet', *_PACKAGES]
        if made.returncode or subprocess.run(command, check=False).returncode:  # noqa: S603
            shutil.rmtree(_KILTED, ignore_errors=True)
    return str(python) if python.exists() else None


def report(found: Found) -> str:
    """Return a table."""
    return table(found)


def plot(found: Found) -> Figure:
    """Draw each case's first figure: medians as dots, ranges as whiskers."""
    from matplotlib.figure import Figure  # noqa: PLC0415 (only where a picture is asked for)

    figure = Figure(figsize=(3.5 * len(found), 3.2), layout='constrained')
    for axes, (case, by_executor) in zip(
        figure.subplots(1, len(found), squeeze=False)[0], found.items(), strict=True
    ):
        key = next(iter(by_executor['ours'][0]))
        for place, (name, runs) in enumerate(by_executor.items()):
            if not (values := [run[key] for run in runs]):
                continue
            color = 'tab:blue' if name == 'ours' else 'dimgray'
            axes.vlines(place, min(values), max(values), color=color)
            axes.plot(place, median(values), 'o', color=color)
            label = f' {median(values):,.4g}'
            axes.annotate(
                label, (place, median(values)), xytext=(6, -3), textcoords='offset points'
            )
        names = [
            TITLES[name].replace('Executor', '').replace('Thr', '\nThr').replace(' ', '\n')
            for name in by_executor
        ]
        axes.set_xticks(range(len(names)), names)
        axes.set(title=case, ylabel=key, yscale='log', xlim=(-0.4, len(names) - 0.2))
        axes.margins(y=0.15)
        axes.spines[['top', 'right']].set_visible(False)
    return figure
