"""A submission's process: requests with deadlines, and how it ended."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.errors import UserError
from barc_sim.lab.grade.protocol import MAX_TEXT, NO_PIPES, REPLY, REQUEST, Status, doubles
from barc_sim.lab.grade.start import ON_LINUX, Limits, Unconfined, start
from barc_sim.lab.grade.text import one_line

if TYPE_CHECKING:
    from collections.abc import Sequence

    from typing_extensions import Self

    from barc_sim.lab.grade.protocol import Operation

_LEAST = 0.01  # [s] between two checks of the processor time
_LAST_WORDS = 5.0  # [s] for a process that has closed its pipes to end by itself


class Failed(Exception):  # noqa: N818 (a reply, no error of the grader)
    """The submission's code has failed; the text is its error. The process continues."""


class Ended(Exception):  # noqa: N818
    """The process has ended; the text continues the sentence "the process …"."""


class Process:
    """Runs the code in `folder`; it may read that folder, Python and NumPy, and nothing else.

    With `sandbox` False only the limits hold: files, network and other processes are open to it.
    """

    def __init__(self, folder: Path, limits: Limits, *, sandbox: bool = True) -> None:
        """Start it, and wait until it is confined.

        Raises
        ------
        Unconfined
            if the kernel cannot do that.
        """
        self._limits = limits
        self._serial = 0
        self._process, self.channel = start(folder, limits, sandbox=sandbox)
        try:
            self._receive(0, limits.start)
        except Failed as error:
            self.close()
            raise Unconfined(str(error)) from None
        except Ended as error:
            raise Unconfined(f'the process {error}') from None
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        """Return the process; it ends with the block."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process."""
        self.close()

    def request(
        self, operation: Operation, values: Sequence[float], count: int, wait: float
    ) -> tuple[float, ...]:
        """Return the `count` doubles of the reply to `values`, of any value, within `wait` [s].

        Raises
        ------
        Failed
            if the submission's code fails.
        Ended
            where the process has ended, was too slow or answered with something else, and so has
            been ended.
        """
        self._serial += 1
        size = len(values)
        frame = REQUEST.pack(self._serial, operation, size) + doubles(size).pack(*values)
        try:
            self.channel.send(frame, time.monotonic() + wait)
        except (EOFError, TimeoutError) as error:
            raise Ended(self._end(error)) from None
        return self._receive(count, wait)

    def close(self) -> None:
        """End the process and all that it has started, and read its output."""
        if self._process.poll() is None:
            # Its group has all that it has started; the number is valid while it lives.
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
        self.channel.close()

    def _receive(self, count: int, wait: float) -> tuple[float, ...]:
        deadline = time.monotonic() + wait
        used_up = self._processor_time() + self._limits.call
        data, whole = b'', REPLY.size
        status = 0
        try:
            while len(data) < whole:
                data += self._next(used_up, deadline)
                if len(data) >= REPLY.size:
                    status, whole = self._header(data, count)
        except (EOFError, TimeoutError, _Garbage) as error:
            raise Ended(self._end(error)) from None
        if len(data) > whole:
            raise Ended(self._end(_Garbage()))
        if status == Status.FAILED:
            raise Failed(one_line(data[REPLY.size :].decode(errors='replace')))
        return doubles(count).unpack_from(data, REPLY.size)

    def _next(self, used_up: float, deadline: float) -> bytes:
        """Return the next bytes of the process.

        On a busy machine the wait can be longer than the processor time, up to the deadline.
        """
        while True:
            left = max(used_up - self._processor_time(), _LEAST)
            try:
                return self.channel.receive(min(time.monotonic() + left, deadline))
            except TimeoutError:
                if self._processor_time() >= used_up:
                    seconds = f'{self._limits.call:g} s of processor time'
                    raise TimeoutError(f'{seconds}; is there an endless loop?') from None
                if time.monotonic() >= deadline:
                    raise

    def _processor_time(self) -> float:
        """Return how long [s] the process has run on a processor."""
        # The clock of clock_getcpuclockid(3), which Python lacks. A process that has ended keeps
        # its time until it is waited for.
        return time.clock_gettime((~self._process.pid << 3) | 2)

    def _header(self, data: bytes, count: int) -> tuple[int, int]:
        """Return the status and the length of the reply."""
        serial, status, size = REPLY.unpack_from(data)
        if serial == self._serial and status == Status.DONE and size == count:
            return status, REPLY.size + 8 * count
        if serial == self._serial and status == Status.FAILED and size <= MAX_TEXT:
            return status, REPLY.size + size
        raise _Garbage

    def _end(self, error: Exception) -> str:
        """End the process; return the reason, which continues the sentence "the process …"."""
        if isinstance(error, EOFError):
            # It has closed its pipes, usually because it is ending.
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_LAST_WORDS)
        code = self._process.poll()
        self.close()
        if isinstance(error, TimeoutError):
            within = str(error) or f'{self._limits.wait:g} s; does it sleep, or wait for something?'
            return f'was ended: it did not answer within {within}'
        if code in {None, NO_PIPES} or isinstance(error, _Garbage):
            return 'was ended: it has written to, or closed, files that are not its own'
        if code == -signal.SIGKILL:
            return f'was ended: it has used up {self._limits.cpu} s of processor time'
        if code is not None and code < 0:
            name = signal.Signals(-code).name
            return f'has crashed with {name}; is a recursion too deep?'
        return f'has ended itself with exit code {code}; a function returns, it does not exit'


class _Garbage(Exception):  # noqa: N818
    """The received bytes are no reply to the request."""


def check(*, sandbox: bool) -> None:
    """Start a process that runs nothing, where processes can be confined.

    Raises
    ------
    UserError
        if it cannot be confined here.
    """
    if not ON_LINUX:
        if sandbox:
            raise UserError(
                f'submissions can be confined on Linux alone, and this is {sys.platform}: grade '
                'there, as in WSL 2 or a container, or give --unconfined, which lets their code '
                'do all that you can'
            )
        return
    try:
        with (
            tempfile.TemporaryDirectory() as folder,
            Process(Path(folder), Limits(), sandbox=sandbox),
        ):
            pass
    except Unconfined as error:
        raise UserError(
            f'submissions cannot be confined on this machine ({error}): grade on Linux 5.13 or '
            'later, or give --unconfined in a container that holds one submission and nothing else'
        ) from None
