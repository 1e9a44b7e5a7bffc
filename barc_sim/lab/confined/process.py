"""Starts the process of a submission, and talks to it in lines of JSON, with deadlines."""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple

from barc_sim.errors import UserError, one_line
from barc_sim.lab.confined import kernel
from barc_sim.lab.confined.child import NO_PIPES

if TYPE_CHECKING:
    from collections.abc import Callable

    from typing_extensions import Self

#: Whether a process can be confined: by the kernel of Linux alone.
ON_LINUX = sys.platform == 'linux'
_SCRIPT = Path(__file__).with_name('child.py')
_PACKAGES = Path(__file__).parents[3]
# The hash seed is fixed, so that sets have the same order each time; `python -I` would ignore it.
# BLAS would start threads, which are refused.
_ENVIRONMENT = {
    'PYTHONHASHSEED': '0',
    'PYTHONUTF8': '1',
    'OPENBLAS_NUM_THREADS': '1',
    'OMP_NUM_THREADS': '1',
}
_MAX_LINE = 16 << 20  # bytes of a reply
_LEAST = 0.01  # [s] between two checks of the processor time
_MARGIN = 0.5  # [s] of processor time, for the process to name the line that ran out of it
_LAST_WORDS = 5.0  # [s] for a process that has closed its pipes to end by itself


class Limits(NamedTuple):
    """Limits of a submission's process, far above the needs of slow code."""

    memory: int = 1 << 30  #: bytes of address space; NumPy takes a fifth of it
    cpu: int = 30  #: [s] of processor time, over all calls
    start: float = 60.0  #: [s] until it is confined; the submission does not run before
    call: float = 3.0  #: [s] of processor time for one request, which can have thousands of calls
    wait: float = 20.0  #: [s] for one request, on a busy machine or with a sleep
    total: float = 120.0  #: [s] for all requests of a submission, waits included
    output: int = 16_384  #: bytes kept of its output


class Unconfined(OSError):  # noqa: N818
    """The process could not be confined; the submission has not run."""


class Failed(Exception):  # noqa: N818 (a reply, no error of the grader)
    """The submission's code has failed; the text is its error. The process continues."""


class Ended(Exception):  # noqa: N818
    """The process has ended; the text continues the sentence "the process …"."""


class Process:
    """Runs the code in `folder`, or reads the `archive`.

    It may read that folder, Python and NumPy, and nothing else. With `sandbox` False only the
    limits hold: files, network and other processes are open to it.
    """

    def __init__(
        self, folder: Path, limits: Limits, *, sandbox: bool = True, archive: Path | None = None
    ) -> None:
        """Start it, and wait until it is confined; where that fails it is `Unconfined`."""
        self._limits = limits
        self._serial = 0
        #: The first bytes of the output, one more than the limit where there are more.
        self.printed = b''
        self._process = _start(folder, limits, archive, sandbox=sandbox)
        self._requests: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._replies: queue.Queue[bytes] = queue.Queue(1)
        # Each end of a pipe has its thread: a process can stop to read, or never stop to print.
        pipes = (self._process.stdin, self._process.stdout, self._process.stderr)
        self._streams = [pipe for pipe in pipes if pipe]
        work = (self._send, self._receive, self._keep_output)
        self._threads = [
            threading.Thread(target=_until_closed, args=pair, daemon=True)
            for pair in zip(work, self._streams, strict=True)
        ]
        for thread in self._threads:
            thread.start()
        try:
            self._reply(limits.start)
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

    def request(self, do: str, *arguments: object, wait: float) -> Any:  # noqa: ANN401 (JSON)
        """Return the reply to a request within `wait` [s]: any value of JSON."""
        self._serial += 1
        request = {'serial': self._serial, 'do': do, 'arguments': arguments}
        self._requests.put(json.dumps(request).encode() + b'\n')
        return self._reply(wait)

    def close(self) -> None:
        """End the process and all that it has started, and read its output."""
        if self._process.poll() is None:
            # Its group has all that it has started; the number is valid while it lives.
            with suppress(ProcessLookupError):
                if hasattr(os, 'killpg'):
                    os.killpg(self._process.pid, signal.SIGKILL)
                else:
                    self._process.kill()
            self._process.wait()
        self._requests.put(b'')
        with suppress(queue.Empty):
            while self._replies.get(timeout=1.0):
                pass
        for thread, stream in zip(self._threads, self._streams, strict=True):
            thread.join(1.0)
            if not thread.is_alive():  # where a process that it has started holds the other end
                with suppress(OSError):
                    stream.close()

    def _send(self, requests: IO[bytes]) -> None:
        for request in iter(self._requests.get, b''):
            requests.write(request)
            requests.flush()

    def _receive(self, replies: IO[bytes]) -> None:
        try:
            while line := replies.readline(_MAX_LINE):
                self._replies.put(line)
        finally:
            self._replies.put(b'')

    def _keep_output(self, output: IO[bytes]) -> None:
        keep = self._limits.output + 1
        while data := os.read(output.fileno(), 1 << 16):
            self.printed += data[: keep - len(self.printed)]

    def _reply(self, wait: float) -> Any:  # noqa: ANN401 (JSON)
        try:
            line = self._next_line(wait)
            reply = json.loads(line)
            serial, error, result = reply['serial'], reply.get('error'), reply.get('result')
        except (
            *(EOFError, TimeoutError),
            *(ValueError, TypeError, LookupError, AttributeError, RecursionError),  # of no reply
        ) as fault:
            raise Ended(self._end(fault)) from None
        if serial != self._serial:
            raise Ended(self._end(ValueError()))
        if error is not None:
            raise Failed(one_line(str(error)))
        return result

    def _next_line(self, wait: float) -> bytes:
        """Return the next line of the process.

        On a busy machine the wait can be longer than the processor time, up to the deadline.
        """
        deadline = time.monotonic() + wait
        used_up = self._processor_time() + self._limits.call + _MARGIN
        while True:
            left = max(used_up - self._processor_time(), _LEAST)
            try:
                line = self._replies.get(timeout=max(min(left, deadline - time.monotonic()), 0.0))
            except queue.Empty:
                if self._processor_time() >= used_up:
                    seconds = f'{self._limits.call:g} s of processor time'
                    raise TimeoutError(f'{seconds}; is there an endless loop?') from None
                if time.monotonic() >= deadline:
                    raise TimeoutError from None
                continue
            if not line:
                self._replies.put(b'')  # for `close`
                raise EOFError
            return line

    def _processor_time(self) -> float:
        """Return how long [s] the process has run on a processor; elsewhere than on Linux, a time.

        That is the clock of clock_getcpuclockid(3), which Python lacks. A process that has ended
        keeps its time until it is waited for.
        """
        if not ON_LINUX:
            return time.monotonic()
        return time.clock_gettime((~self._process.pid << 3) | 2)

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
        if code in {None, NO_PIPES} or not isinstance(error, EOFError):
            return 'was ended: it has written to, or closed, files that are not its own'
        if code == -signal.SIGKILL:
            return f'was ended: it has used up {self._limits.cpu} s of processor time'
        if code is not None and code < 0:
            name = signal.Signals(-code).name
            return f'has crashed with {name}; is a recursion too deep?'
        return f'has ended itself with exit code {code}; a function returns, it does not exit'


def _until_closed(work: Callable[[IO[bytes]], None], stream: IO[bytes]) -> None:
    """Do what a thread does with a pipe until that is closed."""
    with suppress(OSError, ValueError):
        work(stream)


def _start(
    folder: Path, limits: Limits, archive: Path | None, *, sandbox: bool
) -> subprocess.Popen[bytes]:
    """Start `child.py` in `folder`."""
    ruleset, program = None, b''
    passed: list[int] = []
    environment = dict(_ENVIRONMENT)
    if 'SYSTEMROOT' in os.environ:  # Windows starts no process without it
        environment['SYSTEMROOT'] = os.environ['SYSTEMROOT']
    if sandbox:
        try:
            program = kernel.program()
            ruleset = kernel.ruleset_for(folder)
        except OSError as error:
            raise Unconfined(error.strerror or str(error)) from None
        passed = [ruleset]
    arguments = {
        'archive': None if archive is None else str(archive),
        'ruleset': ruleset,
        'program': program.hex(),
        'parent': os.getpid(),
        'packages': str(_PACKAGES),
        'installed': {name: str(kernel.package_folder(name)) for name in ('numpy', 'rosbags')},
        'memory': limits.memory,
        'cpu': limits.cpu,
        'call': limits.call,
    }
    try:
        return subprocess.Popen(  # noqa: S603 (our own script)
            [sys.executable, '-s', '-S', '-B', '-u', str(_SCRIPT), json.dumps(arguments)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            pass_fds=passed,
            cwd=folder,
            env=environment,
            start_new_session=True,
        )
    finally:
        for descriptor in passed:
            os.close(descriptor)


def check(*, sandbox: bool) -> None:
    """Start a process that runs nothing; a UserError if it cannot be confined here."""
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
