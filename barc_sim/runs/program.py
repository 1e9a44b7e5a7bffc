"""A program of a student's, in a process of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

#: Replaces itself by the command after it, which ends with this process, however that ends.
_START = (
    'import ctypes, os, signal, sys\n'
    'set_death_signal = 1\n'
    'ctypes.CDLL(None).prctl(set_death_signal, signal.SIGKILL)\n'
    'os.execv(sys.argv[1], sys.argv[1:])\n'
)
_LAST_WORDS = 2.0  #: [s] for the process to end by itself after a signal
_SHOWN = 200  #: characters of its last line


class Program:
    """Runs a file with this Python, in the ROS domain of the environment, until `close`.

    What it prints is shown line by line.
    """

    def __init__(
        self,
        name: str,
        file: Path,
        show: Callable[[str], None],
        on_death: Callable[[str], None],
        *,
        folder: Path | None = None,
        stdin: int = subprocess.DEVNULL,
    ) -> None:
        """Start it in `folder`, its own unless given.

        If it ends before `close`, `on_death` gets a sentence that begins with `name`. Both
        functions are called in another thread.
        """
        self._name, self._show, self._on_death = name, show, on_death
        self._last = ''
        self._closing = False
        self._process = subprocess.Popen(  # noqa: S603 (the user's own file)
            [sys.executable, '-c', _START, sys.executable, '-u', str(file.resolve())],
            cwd=folder or file.resolve().parent,
            env=os.environ | {'PYTHONIOENCODING': 'utf-8'},
            stdin=stdin,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding='utf-8',
            errors='replace',
            # A Ctrl-C ends the run, which then ends this process.
            start_new_session=True,
        )
        self._thread = threading.Thread(target=self._follow, name='program', daemon=True)
        self._thread.start()

    def _follow(self) -> None:
        assert self._process.stdout  # noqa: S101 (it is a pipe)
        for line in self._process.stdout:
            self._last = line.strip() or self._last
            if not self._closing:
                self._show(line)
        code = self._process.wait()
        if not self._closing:
            end = f'signal {-code}' if code < 0 else f'exit code {code}'
            last = f': {self._last[:_SHOWN]}' if self._last and code else ''
            self._on_death(f'{self._name} has ended with {end}{last}')

    def close(self) -> None:
        """End the process; a second call does nothing."""
        self._closing = True
        for number in (signal.SIGINT, signal.SIGKILL):
            if self._process.poll() is None:
                self._process.send_signal(number)
                with suppress(subprocess.TimeoutExpired):
                    self._process.wait(_LAST_WORDS)
        self._thread.join(_LAST_WORDS)
