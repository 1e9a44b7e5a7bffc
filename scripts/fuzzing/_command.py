"""Runs a command in a process of its own, and judges its end."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import time
import traceback
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple

from _trial import HANG, RESULT, SENTENCE, TRACEBACK

from barc_sim.__main__ import main

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

_PATIENCE = 60.0  #: [s] for a command on a busy machine
_ANSWERS = (0, 1, 2)  #: exit codes
INTERRUPTED = (-signal.SIGINT, 128 + signal.SIGINT)
#: What no user should read: the interpreter's, or a library's, in place of a sentence.
_FAULTS = ('Traceback (most recent call last)', 'Fatal Python error', 'terminate called', ' at 0x')


class Ended(NamedTuple):
    """How a command ended: its exit code, None if it had to be ended; and what it printed."""

    code: int | None
    text: str


def run(
    words: list[str],
    folder: Path,
    prepare: Callable[[], None] = lambda: None,
    live: float | None = None,
) -> Ended:
    """Run `barc` with `words` in `folder`, in a copy of this process, after `prepare`.

    After `live` [s] it is asked to stop, as by Ctrl-C.
    """
    with tempfile.TemporaryFile() as output:
        child = os.fork()
        if not child:
            _child(words, folder, prepare, output.fileno())
        code = _wait(child, live)
        output.seek(0)
        return Ended(code, output.read(1 << 20).decode(errors='replace'))


def _child(words: list[str], folder: Path, prepare: Callable[[], None], output: int) -> None:
    code = 3
    try:
        os.setsid()
        signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
        sys.modules['__main__'] = ModuleType('__main__')  # else its own processes begin with ours
        null = os.open(os.devnull, os.O_RDONLY)
        for here, there in ((null, 0), (output, 1), (output, 2)):
            os.dup2(here, there)
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


def _wait(child: int, live: float | None) -> int | None:
    """Return the exit code of a process, minus the signal that ended it; None where it hangs."""
    began = time.monotonic()
    asked = live is None
    while (since := time.monotonic() - began) < _PATIENCE:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            code = os.waitstatus_to_exitcode(status)
            return 0 if live is not None and asked and code in INTERRUPTED else code
        if live is not None and not asked and since > live:
            os.kill(child, signal.SIGINT)
            asked = True
        time.sleep(0.01)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


def judge(ended: Ended) -> tuple[str, str]:
    """Return the outcome, and why it is a failure, or ''."""
    last = '\n'.join(ended.text.splitlines()[-30:])
    if ended.code is None:
        return HANG, f'no end within {_PATIENCE:g} s\n{last}'
    if ended.code not in _ANSWERS or any(fault in ended.text for fault in _FAULTS):
        return TRACEBACK, f'exit code {ended.code}\n{last}'
    return (SENTENCE if ended.code else RESULT), ''
