"""Starts a submission's process, and calls its functions with JSON lines and deadlines.

The time limits of a submission's code, and what ends it at each:

============================  =======  ===============  ==================================
limit                         default  measures         ends
============================  =======  ===============  ==================================
`ProcessLimits.start`         60 s     time             the process, before any code runs
`ProcessLimits.call`          3 s      processor time   the request, by an alarm in it
`ProcessLimits.wait`          20 s     time             the process
`ProcessLimits.total`         120 s    time of all      every later request
`_LAST_WORDS`, closed pipes   5 s      time             the process
`BUDGET` of `folder.py`       2 s      time of a call   the call, where code is not judged
`_LOADING` of `code.py`       20 s     time of loading  loading, where code is not judged
`_BUDGET` of `relay_program`  10 s     time of a run    the run, where code is not judged
============================  =======  ===============  ==================================

`call` covers a whole request, which can have many calls of a function. The alarm of `call` names
the line; `wait` ends code that sleeps, or that catches the alarm. `check` has shorter limits
(`_CHECKED` of `judge.py`); `grade --time-limit` sets `total`.

What else limits the process depends on `ProcessLimits.confined` and on the system:

==========================  =========================  ===================  ====================
limit                       confined                   not, on Linux        not, elsewhere
==========================  =========================  ===================  ====================
time, as above              yes                        yes                  yes
`memory`, 64 open files     yes                        yes                  no
files that it can read      its folder, Python, NumPy  those of its user    those of its user
files made and deleted      none                       those of its user    those of its user
bytes written into files    none                       none                 no limit
network                     none                       that of its user     that of its user
other processes, threads    none                       none; root: any      no limit
its end with the grader     at once                    at once              after its request
==========================  =========================  ===================  ====================

`check` does not confine, because its user wrote the code; `grade --unconfined` does not either.

The line of a mistake is found in three steps. `judge.py` chooses the wrong values: those of the
quantities that the wrong law changes, and the wrong result itself. The request `lines` repeats the
call with a trace function, which collects each number that a line assigns (`UserCode.lines`).
`JudgedCode.line_of` then returns the first line that assigns one of the wrong values. The values 0
and 1 and the right results do not count: a line that assigns one of these need not be wrong.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from contextlib import AbstractContextManager, suppress
from importlib.util import find_spec
from itertools import count
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.cli.files import read_regular
from barc_sim.cli.text import one_line, without_addresses
from barc_sim.errors import UserError
from barc_sim.lab.confined.child import NO_PIPES, abi
from barc_sim.lab.confined.replies import RESULTS, WrongReply, max_size, parsed
from barc_sim.lab.files import MAX_SOURCE, ChosenGains, ErrorKind, UserCodeError, files_in

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from barc_sim.lab.confined.replies import Shape

_SCRIPT = Path(__file__).with_name('child.py')
_PACKAGES = Path(__file__).parents[3]
# The hash seed is fixed, so that sets have the same order each time; `python -I` would ignore it.
# One thread, because BLAS may not start others.
_ENVIRONMENT = {
    'PYTHONHASHSEED': '0',
    'PYTHONUTF8': '1',
    'OPENBLAS_NUM_THREADS': '1',
    'OMP_NUM_THREADS': '1',
}
_POLL = 0.05  # [s] between two checks of the deadline
_LAST_WORDS = 5.0  # [s] for a process that has closed its pipes to end by itself


class ProcessLimits(NamedTuple):
    """Limits of a submission's process, far above the needs of slow code."""

    memory: int = 1 << 30  #: bytes of address space; NumPy takes a fifth of it
    start: float = 60.0  #: [s] until it is confined; only then does the submission run
    call: float = 3.0  #: [s] of processor time for one request, which can have thousands of calls
    wait: float = 20.0  #: [s] for one request, on a busy machine or with a sleep
    total: float = 120.0  #: [s] for all requests of a submission, waits included
    output: int = 16_384  #: bytes kept of its output
    confined: bool = True  #: the table at the top of this module has what still holds if not


class Unconfined(OSError):  # noqa: N818
    """The process could not be confined; the submission has not run."""


class Failed(Exception):  # noqa: N818 (a reply, no error of the grader)
    """The submission's code raised an error, whose text this has. The process continues."""

    def __init__(self, text: str, kind: ErrorKind) -> None:
        """Make an error of a kind."""
        super().__init__(text)
        self.kind = kind


class Ended(Exception):  # noqa: N818
    """The process has ended; the text continues the sentence "the process …"."""


class Process:
    """A process that runs the code in `folder`.

    If it is `confined`, it may read only that folder, Python and NumPy.
    """

    def __init__(self, folder: Path, limits: ProcessLimits) -> None:
        """Start it, and wait until it is confined; raise `Unconfined` if that fails."""
        self._limits = limits
        self._serial = 0
        self._deadline = inf
        self._is_late = False
        #: The first bytes of the output, with one byte more than the limit if there are more.
        self.printed = b''

        self._process = _start(folder, limits)
        pipes: Any = self._process  # mypy: its pipes are not None
        self._requests = pipes.stdin
        self._replies = pipes.stdout
        self._output = pipes.stderr

        self._printing = threading.Thread(target=self._keep_output, daemon=True)
        self._printing.start()
        threading.Thread(target=self._watch, daemon=True).start()
        try:
            self._reply(b'', limits.start, RESULTS['']())
        except Failed as error:
            self.close()
            raise Unconfined(str(error)) from None
        except Ended as error:
            raise Unconfined(f'the process {error}') from None

    def request(self, do: str, *arguments: object, wait: float) -> Any:  # noqa: ANN401 (JSON)
        """Return the result of a request, which comes within `wait` [s], as `RESULTS` has it.

        Its exceptions are Failed, Ended and WrongReply.
        """
        self._serial += 1
        request = {'serial': self._serial, 'do': do, 'arguments': arguments}
        line = json.dumps(request).encode() + b'\n'
        return self._reply(line, wait, RESULTS[do](*arguments))

    def close(self) -> None:
        """End the process and its child processes, and read its output."""
        self._kill()
        self._process.wait()
        self._printing.join(1.0)
        # A child process can hold the other end of the output: closing would block.
        streams = [self._requests, self._replies]
        if not self._printing.is_alive():
            streams.append(self._output)
        for stream in streams:
            with suppress(OSError):
                stream.close()

    def _kill(self) -> None:
        if self._process.poll() is None:
            # Its group contains its child processes; the id is valid while it runs.
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

    def _reply(self, request: bytes, wait: float, shape: Shape) -> Any:  # noqa: ANN401 (JSON)
        """Send a request, and return its result; kill the process if none comes in `wait` [s]."""
        self._deadline = time.monotonic() + wait
        line = b''
        try:
            with suppress(OSError):
                self._requests.write(request)
                self._requests.flush()
                line = self._replies.readline(max_size(shape))
        except BaseException:
            self.close()
            raise
        finally:
            self._deadline = inf

        try:
            result, error = parsed(line, self._serial)
        except ValueError:
            raise Ended(self._end(line)) from None
        if self._is_late:
            raise Ended(self._end(line))
        if error is not None:
            raise Failed(one_line(error.text), error.kind)
        return shape.checked(result)

    def _end(self, line: bytes) -> str:
        """End the process; return the reason, which continues the sentence "the process …"."""
        if not line:
            # It has closed its pipes, usually because it is about to end.
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_LAST_WORDS)
        code = self._process.poll()
        self.close()

        if self._is_late:
            waited = f'{self._limits.wait:g} s: does the code sleep, or loop without end?'
            return f'was ended, because it did not answer within {waited}'
        if line or code in {None, NO_PIPES}:
            return "was ended, because the code wrote to, or closed, the grader's files"
        if code >= 0:
            return f'ended itself with exit code {code}: use return in a function, not exit'
        return f'crashed with {signal.Signals(-code).name}: is a recursion too deep?'


def _start(folder: Path, limits: ProcessLimits) -> subprocess.Popen[bytes]:
    """Start `child.py` in `folder`."""
    environment = dict(_ENVIRONMENT)
    if 'SYSTEMROOT' in os.environ:  # Windows starts no process without it
        environment['SYSTEMROOT'] = os.environ['SYSTEMROOT']

    try:
        version = abi() if limits.confined else 0
    except OSError as error:
        raise Unconfined(error.strerror or str(error)) from None

    specs: list[Any] = [find_spec(name) for name in ('numpy', 'rosbags', 'system_calls')]
    folders = [Path(spec.submodule_search_locations[0]).resolve().parent for spec in specs]
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


_USUAL = ProcessLimits()
_REQUESTS = 10  # for all rows of a function; each has its own time limit
_MAX_ENDS = 3  # A function that ended its process, or looped, so often is not called again.
_numbers = count()  # of the objects that are made


class JudgedCode(AbstractContextManager['JudgedCode']):
    """Calls a user's files in `folder`, in a process that is confined to it.

    Each failure is a UserCodeError. If a call ends the process, the next call uses a new one. All
    calls together may take `ProcessLimits.total` seconds; after that each call fails.
    """

    def __init__(self, folder: Path, limits: ProcessLimits = _USUAL) -> None:
        """Use the files in `folder`; the process starts at the first call."""
        self._folder = folder
        self._limits = limits
        self._process: Process | None = None
        self._left = limits.total
        self._ends: defaultdict[str, list[str]] = defaultdict(list)  # the reasons, by function
        self._printed = b''
        self._gains: ChosenGains | None = None

    def __exit__(self, *_: object) -> None:
        """End the process."""
        self.close()

    def has(self, part: str) -> bool:
        """Return whether the folder has the file of this part."""
        return part in files_in(self._folder)

    def files(self) -> dict[str, bytes]:
        """Return the files of Python at the top of the folder, by name; none that is too large."""
        files = {}
        for path in self._folder.glob('*.py'):
            with suppress(OSError, UserError):
                files[path.name] = read_regular(path, MAX_SOURCE)
        return files

    def rows(self, name: str, rows: Sequence[Sequence[Any]], corrected: object = None) -> list[Any]:
        """Return a row of the numbers that a user's function returns for each row of arguments.

        For `corrected` see `UserCode.functions`.
        """
        size = max(len(rows) // _REQUESTS, 1)
        results: list[Any] = []
        while len(results) < len(rows):
            part = rows[len(results) :][:size]
            reply = self.call('functions', name, part, False, corrected)
            results += [(row,) if isinstance(row, float) else tuple(row) for row in reply]
        return results

    def make(self, name: str, *arguments: Any) -> int:  # noqa: ANN401 (JSON)
        """Make a new object of a user's class; return its number.

        Its file is loaded again, so that global variables have their first values.
        """
        number = next(_numbers)
        self.call('make', name, number, *arguments)
        return number

    def steps(self, name: str, number: int, rows: Sequence[Sequence[float]]) -> list[float]:
        """Return the outputs of an object for the rows of inputs in turn."""
        outputs: list[float] = self.call('steps', name, number, rows)
        return outputs

    def chosen_gains(self) -> ChosenGains | None:
        """Return the gains that `controller.py` chooses; None if it is not loaded or has none."""
        reply = self._notes().get('gains')
        if reply:
            gains = ChosenGains(*reply)
            self._gains = gains._replace(origin=one_line(gains.origin))  # the process may end
        return self._gains

    def tolerated(self) -> tuple[str, ...]:
        """Return the faults of the loaded files that cost nothing, a phrase each."""
        return tuple(map(one_line, self._notes().get('tolerated', ())))

    def line_of(
        self, do: str, arguments: Sequence[Any], values: Iterable[float], others: Iterable[float]
    ) -> str:
        """Return the file and line that first assigns one of the `values` in a request.

        Values that are also in `others` do not count. If no line assigns one, it is the line that
        returns; empty if that is unknown.
        """
        try:
            lines = self.call('lines', do, *arguments)
        except UserCodeError:
            return ''

        # Any right line can assign these.
        innocent = np.array([0.0, 1.0, *others])
        wrong = np.array([v for v in values if not np.isclose(v, innocent, 1e-12, 0.0).any()])
        for place, value in lines:
            if np.isclose(value, wrong, 1e-9, 0.0).any():
                return one_line(place)
        last_place = lines[-1][0] if lines else ''
        return one_line(last_place)

    def _notes(self) -> dict[str, Any]:
        try:
            notes: dict[str, Any] = self.call('notes')
        except UserCodeError:
            return {}
        return notes

    @property
    def printed(self) -> str:
        """The first output of the processes that have ended."""
        text = without_addresses(self._printed[: self._limits.output].decode(errors='replace'))
        return f'{text}\n[and more]' if len(self._printed) > self._limits.output else text

    def call(self, do: str, *arguments: Any) -> Any:  # noqa: ANN401 (JSON)
        """Return the result of a request; a UserCodeError if it fails, or ends its process."""
        function = self._function_of(do, *arguments)
        ends = self._ends[function]
        if len(ends) >= _MAX_ENDS:
            raise UserCodeError(ends[-1])
        if self._left <= 0.0:
            raise UserCodeError(self._out_of_time())

        if self._process is None:
            if do == 'notes':
                return {}
            self._process = Process(self._folder, self._limits)

        began = time.monotonic()
        try:
            return self._process.request(do, *arguments, wait=min(self._limits.wait, self._left))
        except Failed as error:
            if error.kind is ErrorKind.ENDLESS:  # such a call uses up its time limit
                ends.append(str(error))
            raise UserCodeError(str(error), error.kind) from None
        except WrongReply as error:
            raise UserCodeError(f'{function} returned something other than {error}') from None
        except Ended as error:
            self.close()
            if time.monotonic() - began >= self._left:
                raise UserCodeError(self._out_of_time()) from None
            ends.append(f'{function}: the process that called it {error}')
            raise UserCodeError(ends[-1]) from None
        finally:
            self._left -= time.monotonic() - began

    def _function_of(self, do: str, *arguments: Any) -> str:  # noqa: ANN401 (JSON)
        """Return the name of the user's function that a request calls."""
        if do == 'lines':
            return self._function_of(*arguments)
        if do == 'relay_commands':
            return 'relay'
        return str(arguments[0]) if arguments else do

    def _out_of_time(self) -> str:
        return (
            f'the code has used up its total of {self._limits.total:g} s: does it sleep, or wait '
            'for something?'
        )

    def close(self) -> None:
        """End the process, if there is one."""
        if self._process is not None:
            self._process.close()
            self._printed += self._process.printed
            self._process = None


def check_confinement(limits: ProcessLimits) -> None:
    """Check that a process can be confined on this machine, else raise a UserError."""
    if sys.platform != 'linux':  # only the kernel of Linux can confine a process
        if limits.confined:
            raise UserError(
                f'submissions can be confined only on Linux, and this is {sys.platform}: grade on '
                'Linux, for example in WSL 2 or a container, or give --unconfined, with which '
                'their code can do all that you can'
            )
        return
    try:
        with tempfile.TemporaryDirectory() as folder:
            Process(Path(folder), limits).close()
    except Unconfined as error:
        raise UserError(
            f'submissions cannot be confined on this machine ({error}): grade on Linux 5.13 or '
            'later, or give --unconfined in a container that contains only one submission'
        ) from None
