"""Runs a command in a process of its own, and judges its end."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import time
import traceback
from math import inf
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple, NoReturn

from _trial import HANG, RESULT, SENTENCE, TRACEBACK

from barc_sim.__main__ import main

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

_TIMEOUT = 60.0  #: [s] for a command on a busy machine
_EXIT_CODES = (0, 1, 2)  #: of a command that has given a result or a sentence
INTERRUPTED = (-signal.SIGINT, 128 + signal.SIGINT)
#: What no user should read in place of a sentence: the interpreter's text, or a library's.
_FAULTS = ('Traceback (most recent call last)', 'Fatal Python error', 'terminate called', ' at 0x')


class CommandEnd(NamedTuple):
    """How a command ended: its exit code, None if it had to be ended; and what it printed."""

    code: int | None
    text: str


def run(
    words: list[str],
    folder: Path,
    prepare: Callable[[], None] = lambda: None,
    duration: float | None = None,
) -> CommandEnd:
    """Run `barc` in a copy of this process.

    Parameters
    ----------
    words
        The command and its options.
    folder
        The working directory.
    prepare
        Is called in the new process first.
    duration
        [s] After it the command is asked to stop, as by Ctrl-C; None: never.
    """
    with tempfile.TemporaryFile() as output:
        child = os.fork()
        if not child:
            _run_in_child(words, folder, prepare, output.fileno())
        code = _wait(child, duration)
        output.seek(0)
        return CommandEnd(code, output.read(1 << 20).decode(errors='replace'))


def _run_in_child(
    words: list[str], folder: Path, prepare: Callable[[], None], output: int
) -> NoReturn:
    code = 3
    try:
        os.setsid()
        signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
        sys.modules['__main__'] = ModuleType('__main__')  # else its own processes begin with ours

        null = os.open(os.devnull, os.O_RDONLY)
        os.dup2(null, 0)
        os.dup2(output, 1)
        os.dup2(output, 2)

        os.chdir(folder)
        prepare()
        code = main(words)
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException:  # noqa: BLE001 (what is looked for)
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _wait(child: int, duration: float | None) -> int | None:
    """Return the exit code of a process, minus the signal that ended it; None where it hangs."""
    start = time.monotonic()
    stop_time = inf if duration is None else start + duration
    is_stopping = False
    while time.monotonic() < start + _TIMEOUT:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            code = os.waitstatus_to_exitcode(status)
            return 0 if is_stopping and code in INTERRUPTED else code

        if not is_stopping and time.monotonic() > stop_time:
            os.kill(child, signal.SIGINT)
            is_stopping = True
        time.sleep(0.01)

    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


def judge(end: CommandEnd) -> tuple[str, str]:
    """Return the outcome, and the reason if it is a failure, or ''."""
    last_lines = '\n'.join(end.text.splitlines()[-30:])
    if end.code is None:
        return HANG, f'no end within {_TIMEOUT:g} s\n{last_lines}'
    if end.code not in _EXIT_CODES or any(fault in end.text for fault in _FAULTS):
        return TRACEBACK, f'exit code {end.code}\n{last_lines}'
    if end.code:
        return SENTENCE, ''
    return RESULT, ''
