"""What the commands share: one-line errors and exit codes."""

from __future__ import annotations

import argparse
import os
import sys
from typing import TYPE_CHECKING, NoReturn

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable

USAGE_ERROR = 2
INTERRUPTED = 130


class Parser(argparse.ArgumentParser):
    """An ArgumentParser whose errors are one line; `--help` says the rest."""

    def error(self, message: str) -> NoReturn:
        """Print `message` on stderr in one line and exit with code 2."""
        self.exit(USAGE_ERROR, f'{_error_line(self.prog, message)} (see --help)\n')


def call(prog: str, main: Callable[[], int | None]) -> int:
    """Run `main` and return the command's exit code.

    A UserError becomes one line on stderr and code 2, Ctrl-C code 130, and a reader that went
    away (`| head`) ends the command silently.
    """
    try:
        code = main() or 0
    except UserError as error:
        _report(prog, str(error))
        code = USAGE_ERROR
    except KeyboardInterrupt:
        code = INTERRUPTED
    except BrokenPipeError:
        code = 0
    return _flushed(prog, code)


def _flushed(prog: str, code: int) -> int:
    """Write what waits for stdout, where a failure can still be told, and return the exit code."""
    try:
        if sys.stdout:
            sys.stdout.flush()
    except OSError as error:
        # Python flushes stdout at exit once more: let that go nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            _report(prog, f'what there is to say cannot be written: {error.strerror}')
            return USAGE_ERROR
    return code


def _report(prog: str, message: str) -> None:
    print(_error_line(prog, message), file=sys.stderr)  # noqa: T201


def _error_line(prog: str, message: str) -> str:
    return f'{prog}: error: {" ".join(message.splitlines())}'
