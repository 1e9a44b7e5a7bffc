"""Starts the process of a submission, and talks to it in lines of JSON, with deadlines."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from importlib.util import find_spec
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.errors import UserError, one_line
from barc_sim.lab.confined.child import NO_PIPES, abi

if TYPE_CHECKING:
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
_POLL = 0.05  # [s] between two looks at the deadline
_LAST_WORDS = 5.0  # [s] for a process that has closed its pipes to end by itself


class Limits(NamedTuple):
    """Limits of a submission's process, far above the needs of slow code."""

    memory: int = 1 << 30  #: bytes of address space; NumPy takes a fifth of it
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
    """Runs the code in `folder`.

    It may read that folder, Python and NumPy, and nothing else. With `sandbox` False only the
    limits hold: files, network and other processes are open to it.
    """

    def __init__(self, folder: Path, limits: Limits, *, sandbox: bool = True) -> None:
        """Start it, and wait until it is confined; where that fails it is `Unconfined`."""
        self._limits = limits
        self._serial = 0
        self._deadline, self._is_late = inf, False
        #: The first bytes of the output, one more than the limit where there are more.
        self.printed = b''
        self._process = _start(folder, limits, sandbox=sandbox)
        pipes: Any = self._process  # they are there
        self._requests, self._replies, self._output = pipes.stdin, pipes.stdout, pipes.stderr
        self._printing = threading.Thread(target=self._keep_output, daemon=True)
        self._printing.start()
        threading.Thread(target=self._watch, daemon=True).start()
        try:
            self._reply(b'', limits.start)
        except Failed as error:
            self.close()
            raise Unconfined(str(error)) from None
        except Ended as error:
            raise Unconfined(f'the process {error}') from None

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
        return self._reply(json.dumps(request).encode() + b'\n', wait)

    def close(self) -> None:
        """End the process and all that it has started, and read its output."""
        self._kill()
        self._process.wait()
        self._printing.join(1.0)
        # A process that it has started can hold the other end of the output.
        held = self._printing.is_alive()
        for stream in (self._requests, self._replies, *(() if held else (self._output,))):
            with suppress(OSError):
                stream.close()

    def _kill(self) -> None:
        if self._process.poll() is None:
            # Its group has all that it has started; the number is valid while it lives.
            with suppress(ProcessLookupError):
                if hasattr(os, 'killpg'):
                    os.killpg(self._process.pid, signal.SIGKILL)
                else:
                    self._process.kill()

    def _watch(self) -> None:
        """Kill the process when it does not reply in time."""
        while self._process.poll() is None and not self._is_late:
            time.sleep(_POLL)
            if time.monotonic() >= self._deadline:
                self._is_late = True
                self._kill()

    def _keep_output(self) -> None:
        keep = self._limits.output + 1
        with suppress(OSError):
            while data := os.read(self._output.fileno(), 1 << 16):
                self.printed += data[: keep - len(self.printed)]

    def _reply(self, request: bytes, wait: float) -> Any:  # noqa: ANN401 (JSON)
        """Send a request; its process is killed where no reply comes within `wait` [s]."""
        self._deadline = time.monotonic() + wait
        line = b''
        try:
            with suppress(OSError):
                self._requests.write(request)
                self._requests.flush()
                line = self._replies.readline(_MAX_LINE)
        except BaseException:
            self.close()
            raise
        finally:
            self._deadline = inf
        try:
            reply = json.loads(line)
            serial, error, result = reply['serial'], reply.get('error'), reply.get('result')
        except (ValueError, TypeError, LookupError, AttributeError, RecursionError):
            serial = None
        if serial != self._serial or self._is_late:
            raise Ended(self._end(line))
        if error is not None:
            raise Failed(one_line(str(error)))
        return result

    def _end(self, line: bytes) -> str:
        """End the process; return the reason, which continues the sentence "the process …"."""
        if not line:
            # It has closed its pipes, usually because it is ending.
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_LAST_WORDS)
        code = self._process.poll()
        self.close()
        if self._is_late:
            waited = f'{self._limits.wait:g} s; does it sleep, or loop without end?'
            return f'was ended: it did not answer within {waited}'
        if line or code in {None, NO_PIPES}:
            return 'was ended: it has written to, or closed, files that are not its own'
        if code >= 0:
            return f'has ended itself with exit code {code}; a function returns, it does not exit'
        return f'has crashed with {signal.Signals(-code).name}; is a recursion too deep?'


def _start(folder: Path, limits: Limits, *, sandbox: bool) -> subprocess.Popen[bytes]:
    """Start `child.py` in `folder`."""
    environment = dict(_ENVIRONMENT)
    if 'SYSTEMROOT' in os.environ:  # Windows starts no process without it
        environment['SYSTEMROOT'] = os.environ['SYSTEMROOT']
    try:
        version = abi() if sandbox else 0
    except OSError as error:
        raise Unconfined(error.strerror or str(error)) from None
    needed: list[Any] = [find_spec(name) for name in ('numpy', 'rosbags', 'system_calls')]
    folders = [Path(each.submodule_search_locations[0]).resolve().parent for each in needed]
    arguments = {
        'landlock': version,
        'parent': os.getpid(),
        'packages': [*map(str, (_PACKAGES, *folders))],
        'memory': limits.memory,
        'call': limits.call,
    }
    return subprocess.Popen(  # noqa: S603 (our own script)
        [sys.executable, '-s', '-S', '-B', '-u', str(_SCRIPT), json.dumps(arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=folder,
        env=environment,
        start_new_session=True,
    )


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
