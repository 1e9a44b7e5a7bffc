"""A run in a process of its own, in a terminal or not, and the faults of its end."""

from __future__ import annotations

import os
import pty
import re
import select
import subprocess
import sys
import termios
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import signal

#: The lock of a participant's own segment; it only maps those of others.
_LOCK = re.compile(r'/dev/shm/(fastrtps_[0-9a-f]{16})_el')  # noqa: S108 (DDS's)
#: As a terminal window does it: the pseudo-terminal controls the process.
_TAKE_TERMINAL = 'import fcntl, os, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0); '
_EXECUTE = 'os.execv(sys.executable, [sys.executable, *sys.argv[1:]])'
_BLOCK_SIGNALS = ('env', '--block-signal=INT,TERM,HUP')
_TICK = 0.005  #: [s]
_END_TIMEOUT = 30.0  #: [s]
#: Exit codes of a run that has ended by itself or by a signal.
_EXIT_CODES = {0, 130, -2, -15}
_HIDE_CURSOR = b'\x1b[?25l'
_SHOW_CURSOR = b'\x1b[?25h'


class _Terminal:
    """A pseudo-terminal: its program's side and its user's side."""

    def __init__(self) -> None:
        self.user, self.program = pty.openpty()
        self._attributes = termios.tcgetattr(self.program)

    def is_unchanged(self) -> bool:
        return termios.tcgetattr(self.program) == self._attributes

    def close(self) -> None:
        os.close(self.program)
        os.close(self.user)


class Session:
    """`python -m barc_sim.run` with options, from its start to its end.

    Parameters
    ----------
    folder
        It runs in it.
    *options
        Of the command line.
    terminal
        Whether it runs in a terminal.
    blocked
        Whether signals are blocked until it handles them, as scripts/run does it.
    """

    def __init__(self, folder: Path, *options: str, terminal: bool, blocked: bool) -> None:
        self.output = b''
        self._locks: set[str] = set()  #: names in /dev/shm that it has had open
        self._was_killed = False
        self._terminal: _Terminal | None = None
        stdin = subprocess.DEVNULL
        stdout = subprocess.PIPE
        stderr = subprocess.STDOUT
        if terminal:
            self._terminal = _Terminal()
            stdin = self._terminal.program
            stdout = self._terminal.program
            stderr = self._terminal.program

        command = [sys.executable]
        if terminal:
            command += ['-c', _TAKE_TERMINAL + _EXECUTE]
        if blocked:
            command = [*_BLOCK_SIGNALS, *command]
        self.process = subprocess.Popen(  # noqa: S603 (our own)
            [*command, '-m', 'barc_sim.run', *options],
            cwd=folder,
            stdin=stdin,
            stdout=stdout,
            stderr=stderr,
            start_new_session=True,
        )

    def watch(self, seconds: float) -> bool:
        """Watch it until it ends, for `seconds` at most; return whether it has ended."""
        deadline = time.monotonic() + seconds
        while self.process.poll() is None and time.monotonic() < deadline:
            self._note_locks()
            self._read(_TICK)
        return self.process.returncode is not None

    def stop(self, number: signal.Signals) -> float:
        """Send it a signal; return after how many seconds it has ended."""
        start = time.monotonic()
        self.process.send_signal(number)
        if not self.watch(_END_TIMEOUT):
            self._was_killed = True
            self.process.kill()
            self.process.wait()
        return time.monotonic() - start

    def _note_locks(self) -> None:
        with suppress(OSError):
            for file in Path(f'/proc/{self.process.pid}/fd').iterdir():
                lock = _LOCK.fullmatch(str(file.readlink()))
                if lock:
                    self._locks.add(lock[1])

    def _read(self, seconds: float) -> bool:
        """Wait for output for `seconds` at most; return whether there was some."""
        descriptor = self._output_descriptor()
        if not select.select([descriptor], [], [], seconds)[0]:
            return False
        with suppress(OSError):  # a terminal whose last process is gone
            piece = os.read(descriptor, 65536)
            self.output += piece
            return bool(piece)
        return False

    def _output_descriptor(self) -> int:
        if self._terminal:
            return self._terminal.user
        assert self.process.stdout  # noqa: S101 (a pipe)
        return self.process.stdout.fileno()

    def faults(self) -> list[str]:
        """Return what is wrong with its end, and close what is open."""
        while self._read(0.0):
            pass

        faults = [*self._exit_faults(), *self._remains()]
        if self._terminal:
            faults += self._terminal_faults(self._terminal)
            self._terminal.close()
        elif self.process.stdout:
            self.process.stdout.close()
        return faults

    def _exit_faults(self) -> list[str]:
        faults = []
        if self._was_killed:
            faults.append('does not end')
        elif self.process.returncode not in _EXIT_CODES:
            faults.append(f'exit code {self.process.returncode}')

        text = self.output.decode(errors='replace')
        faults += [word for word in ('Traceback', 'Exception ignored') if word in text]
        return faults

    def _remains(self) -> list[str]:
        """Return what is left of it: processes, and files of DDS."""
        faults = []
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, 0)
            faults.append('a process is left')

        files = [name for name in sorted(self._locks) if Path('/dev/shm', name).exists()]  # noqa: S108
        if files:
            faults.append(f'left in /dev/shm: {files}')
        return faults

    def _terminal_faults(self, terminal: _Terminal) -> list[str]:
        faults = []
        if not terminal.is_unchanged():
            faults.append('the terminal is not as it was')
        if self.output.rfind(_HIDE_CURSOR) > self.output.rfind(_SHOW_CURSOR):
            faults.append('the cursor is hidden')
        return faults
