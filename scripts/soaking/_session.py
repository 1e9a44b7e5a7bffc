"""A run in a process of its own, in a terminal or not, whose end is looked at from all sides."""

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

#: The lock of a participant's own segment; those of others it only maps.
_LOCK = re.compile(r'/dev/shm/(fastrtps_[0-9a-f]{16})_el')  # noqa: S108 (DDS's)
#: As a terminal window does it: the pseudo-terminal controls the process.
_TAKE_TERMINAL = 'import fcntl, os, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0); '
_EXECUTE = 'os.execv(sys.executable, [sys.executable, *sys.argv[1:]])'
_TICK = 0.005
_PATIENCE = 30.0  #: [s]
_HIDE = b'\x1b[?25l'
_SHOW = b'\x1b[?25h'


class Session:
    """`python -m barc_sim.run` with these options, in a folder, from its start to its end."""

    def __init__(self, folder: Path, *options: str, terminal: bool, blocked: bool) -> None:
        """Start it; `blocked` holds signals back as scripts/run does until they are handled."""
        self.folder = folder
        self.shown = b''
        self.shared: set[str] = set()  # names in /dev/shm that it has had open
        self.killed = False
        self._user: int | None = None
        self._fd: int | None = None
        if terminal:
            self._user, self._fd = pty.openpty()
        if self._fd is not None:
            self._before = termios.tcgetattr(self._fd)
        python = ['-c', _TAKE_TERMINAL + _EXECUTE] if terminal else []
        held = ['env', '--block-signal=INT,TERM,HUP'] if blocked else []
        stream = self._fd if terminal else subprocess.PIPE
        self.process = subprocess.Popen(  # noqa: S603 (our own)
            [*held, sys.executable, *python, '-m', 'barc_sim.run', *options],
            cwd=folder,
            stdin=self._fd if terminal else subprocess.DEVNULL,
            stdout=stream,
            stderr=self._fd if terminal else subprocess.STDOUT,
            start_new_session=True,
        )
        self._out = self._user if self._user is not None else self.process.stdout.fileno()  # type: ignore[union-attr]

    def look(self, seconds: float) -> bool:
        """Watch it for so long, or until it ends; return whether it has ended."""
        end = time.monotonic() + seconds
        while self.process.poll() is None and time.monotonic() < end:
            self._watch()
        return self.process.returncode is not None

    def stop(self, number: signal.Signals) -> float:
        """Send it a signal; return after how many seconds it has ended."""
        sent = time.monotonic()
        self.process.send_signal(number)
        if not self.look(_PATIENCE):
            self.killed = True
            self.process.kill()
            self.process.wait()
        return time.monotonic() - sent

    def _watch(self) -> None:
        with suppress(OSError):
            for file in Path(f'/proc/{self.process.pid}/fd').iterdir():
                if lock := _LOCK.fullmatch(str(file.readlink())):
                    self.shared.add(lock[1])
        self._read(_TICK)

    def _read(self, seconds: float) -> bool:
        if select.select([self._out], [], [], seconds)[0]:
            with suppress(OSError):  # a terminal whose last process is gone
                piece = os.read(self._out, 65536)
                self.shown += piece
                return bool(piece)
        return False

    def faults(self) -> list[str]:
        """Return what is wrong with its end; closes what is open."""
        while self._read(0.0):
            pass
        code = self.process.returncode
        found = []
        if self.killed:
            found.append('does not end')
        elif code not in {0, 130, -2, -15}:
            found.append(f'exit code {code}')
        text = self.shown.decode(errors='replace')
        found += [word for word in ('Traceback', 'Exception ignored') if word in text]
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, 0)
            found.append('a process is left')
        if left := [name for name in sorted(self.shared) if Path('/dev/shm', name).exists()]:  # noqa: S108
            found.append(f'left in /dev/shm: {left}')
        if self._fd is not None and self._user is not None:
            if termios.tcgetattr(self._fd) != self._before:
                found.append('the terminal is not as it was')
            if self.shown.rfind(_HIDE) > self.shown.rfind(_SHOW):
                found.append('the cursor is hidden')
            os.close(self._fd)
            os.close(self._user)
        elif self.process.stdout:
            self.process.stdout.close()
        return found
