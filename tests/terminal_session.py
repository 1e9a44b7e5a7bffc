"""A drive by hand in a pseudo-terminal."""

from __future__ import annotations

import os
import pty
import re
import select
import subprocess
import sys
import termios
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

DEADLINE = 100.0
READY = b'q ends'
# As a terminal window does it: the pseudo-terminal controls the process.
TAKE_TERMINAL = 'import fcntl, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0)\n'
MAIN = 'from barc_sim.run import main; sys.exit(main())'


class Session:
    """A run of `barc teleop` in a terminal of its own."""

    def __init__(self, folder: Path, *options: str, script: str = '') -> None:
        self.folder = folder
        self.user, self.fd = pty.openpty()
        self.before = termios.tcgetattr(self.fd)
        self.shown = b''
        self.process = subprocess.Popen(
            [sys.executable, '-c', TAKE_TERMINAL + script + MAIN, 'teleop', *options],
            cwd=folder,
            env=os.environ | {'TERM': 'xterm'},
            stdin=self.fd,
            stdout=self.fd,
            stderr=self.fd,
            start_new_session=True,
        )

    def type(self, keys: bytes) -> None:
        """Send what keys send."""
        os.write(self.user, keys)

    def hold(self, key: bytes, seconds: float) -> None:
        """Hold a key as a keyboard does: half a second's delay, then 30 repeats a second."""
        start = time.monotonic()
        self.type(key)
        self.look(0.5)
        while time.monotonic() < start + seconds:
            self.type(key)
            self.look(0.03)

    def look(self, seconds: float) -> None:
        """Read what is shown, for so long."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            if select.select([self.user], [], [], left)[0]:
                self.shown += os.read(self.user, 4096)

    def until(self, pattern: bytes) -> None:
        """Read until `pattern` is shown, from now on."""
        start, end = len(self.shown), time.monotonic() + DEADLINE
        while not re.search(pattern, self.shown[start:]):
            assert time.monotonic() < end, self.shown[-2000:].decode()
            self.look(0.05)

    def end(self) -> int:
        """Return the exit code, once it has ended."""
        end = time.monotonic() + DEADLINE
        while self.process.poll() is None:
            assert time.monotonic() < end, self.shown[-2000:].decode()
            self.look(0.05)
        self.look(0.05)
        return self.process.returncode

    def bag(self) -> Path:
        """Return the bag."""
        (path,) = (self.folder / 'bags').iterdir()
        return path

    def close(self) -> None:
        """Kill the run if it has not ended, and close the terminal."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        os.close(self.user)
        os.close(self.fd)
