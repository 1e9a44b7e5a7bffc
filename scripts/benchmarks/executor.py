"""The executor beside rclpy's own: round trips per second and processor time.

Two nodes answer one another as fast as they can, once more beside a busy Python thread, across two
processes, and with the recorder on. Where Python 3.12 can be had, Kilted's EventsExecutor is
measured, too, in a virtual environment of its own that is made once.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from _compare import (
    EVENTS_EXECUTORS,
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

#: The C++ executors do not end across two processes, and cannot have our recorder.
_CASES = {
    'ping-pong': True,
    'ping-pong, busy thread': True,
    'ping-pong, two processes': False,
    'ping-pong, recorded': False,
}
_KILTED = Path(__file__).parents[2] / '.setup' / 'kilted'
_PACKAGES = ('ros-kilted-rclpy', 'ros-kilted-std-msgs', 'ros-kilted-rmw-fastrtps-cpp', 'numpy')
QUICK = ('--repeat', '1', '--seconds', '1', '--case', 'ping-pong, recorded')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_number(parser, '--repeat', 5, 'repetitions')
    add_number(parser, '--seconds', 5, 'of each measurement', 'S')
    add_case(parser, _CASES)


def measure(options: argparse.Namespace) -> Results:
    """Return the figures of each case and executor, a list of one per repetition."""
    cases = options.case or list(_CASES)
    pythons = dict.fromkeys([*EXECUTORS, 'events'], sys.executable)
    kilted = None
    if any(_CASES[case] for case in cases):
        kilted = _kilted()
    if kilted:
        pythons['kilted'] = kilted

    def measure_once(case: str, executor: str) -> Figures:
        return run_worker(
            '_ping_pong.py',
            pythons[executor],
            case=case,
            executor=executor,
            seconds=options.seconds,
        )

    subjects = {case: pythons if _CASES[case] else EXECUTORS for case in cases}
    return measure_in_turns(subjects, options.repeat, measure_once)


def _kilted() -> str | None:
    """Return the Python of an environment with Kilted's rclpy; None where there is none."""
    python = _KILTED / 'bin' / 'python'
    base = _python_3_12()
    if base and not python.exists():
        print("making an environment with Kilted's rclpy", file=sys.stderr)
        _make_kilted(base, python)
    return str(python) if python.exists() else None


def _python_3_12() -> str | None:
    # pyenv's command is there for versions that are not chosen, too, and does not work then.
    installed = Path('~/.pyenv/versions').expanduser().glob('3.12.*/bin/python')
    of_pyenv = next(installed, None)
    return str(of_pyenv) if of_pyenv else shutil.which('python3.12')


def _make_kilted(base: str, python: Path) -> None:
    """Make the environment; leave nothing of it where a step fails."""
    commands = (
        [base, '-m', 'venv', str(_KILTED)],
        [str(python), '-m', 'pip', 'install', '--quiet', *_PACKAGES],
    )
    for command in commands:
        if subprocess.run(command, check=False).returncode:  # noqa: S603
            shutil.rmtree(_KILTED, ignore_errors=True)
            return


def report(results: Results) -> str:
    """Return a table."""
    return table(results, EXECUTORS | EVENTS_EXECUTORS)
