"""What the commands share: one-line errors and exit codes."""

from __future__ import annotations

import argparse
import os
import sys
from typing import TYPE_CHECKING, NoReturn

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable

#: What the set-up brings, by package.
_ROS = {'rclpy': 'ROS 2 (rclpy)', 'barc_interfaces': 'barc_interfaces'}
USAGE_ERROR = 2
INTERRUPTED = 130


class Parser(argparse.ArgumentParser):
    """An ArgumentParser whose errors are one line; `--help` says the rest."""

    def error(self, message: str) -> NoReturn:
        """Print `message` on stderr in one line and exit with code 2."""
        self.exit(USAGE_ERROR, f'{_error_line(self.prog, message)} (see --help)\n')


def call(prog: str, main: Callable[[], int | None]) -> int:
    """Run `main` and return the command's exit code.

    A UserError becomes one line on stderr and code 2, so does a Python without ROS; Ctrl-C becomes
    code 130, and a reader that went away (`| head`) ends the command silently.
    """
    try:
        try:
            return main() or 0
        finally:
            # What waits in the buffer would otherwise fail at exit, where nobody can catch it.
            if sys.stdout:
                sys.stdout.flush()
    except UserError as error:
        report(prog, str(error))
        return USAGE_ERROR
    except ModuleNotFoundError as error:
        package = (error.name or '').partition('.')[0]
        if package not in _ROS:
            raise
        report(
            prog,
            f'{_ROS[package]} is not installed in this Python: start with ./scripts/run or '
            './scripts/shell, which set it up, or source a ROS 2 Jazzy workspace',
        )
        return USAGE_ERROR
    except KeyboardInterrupt:
        return INTERRUPTED
    except OSError as error:
        if error.filename:
            raise
        if sys.stdout:
            # Python flushes stdout at exit once more: let that go nowhere.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            return 0
        report(prog, f'the output cannot be written: {error.strerror}')
        return USAGE_ERROR


def report(prog: str, message: str) -> None:
    """Print an error on stderr, in one line."""
    print(_error_line(prog, message), file=sys.stderr)  # noqa: T201


def _error_line(prog: str, message: str) -> str:
    return f'{prog}: error: {" ".join(message.splitlines())}'
