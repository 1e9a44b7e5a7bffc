"""Starts the process of a submission, and talks to it in lines of JSON, with deadlines.

Linux confines it. Landlock, the kernel's own sandbox, refuses files, TCP, signals and abstract
sockets. A seccomp filter refuses all system calls but those below, with EPERM: new processes and
threads, signals, sockets, ptrace, io_uring, mounts, keys, and the calls of later kernels. What the
kernel lacks or refuses is an OSError.

Both are written by hand. The library landlock on PyPI has had only development releases since 2022,
and refuses neither networks nor signals; those for seccomp (pyseccomp, for one) need libseccomp
from the system, which is not on every machine.
"""

from __future__ import annotations

import ctypes
import importlib.util
import json
import os
import platform
import signal
import stat
import subprocess
import sys
import sysconfig
import tempfile
import threading
import time
from contextlib import suppress
from errno import ENOTTY, EPERM
from functools import cache
from math import inf
from os import O_RDONLY, O_RDWR, O_TRUNC, O_WRONLY
from pathlib import Path
from struct import pack
from typing import TYPE_CHECKING, Any, NamedTuple

from system_calls import NotSupportedSystemCall, syscalls

from barc_sim.errors import UserError, one_line
from barc_sim.lab.confined.child import NO_PIPES

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

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
    ruleset, program = None, b''
    passed: list[int] = []
    environment = dict(_ENVIRONMENT)
    if 'SYSTEMROOT' in os.environ:  # Windows starts no process without it
        environment['SYSTEMROOT'] = os.environ['SYSTEMROOT']
    if sandbox:
        try:
            program = call_filter()
            ruleset = ruleset_for(folder)
        except OSError as error:
            raise Unconfined(error.strerror or str(error)) from None
        passed = [ruleset]
    arguments = {
        'ruleset': ruleset,
        'program': program.hex(),
        'parent': os.getpid(),
        'packages': [
            str(_PACKAGES),
            *(str(package_folder(name).parent) for name in ('numpy', 'rosbags')),
        ],
        'memory': limits.memory,
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


# Landlock. Its calls have the same numbers on all architectures.
_CREATE_RULESET, _ADD_RULE = 444, 445
_VERSION = 1
_PATH_BENEATH = 1
_WRITE_FILE, _READ_FILE, _READ_DIR = 1 << 1, 1 << 2, 1 << 3
# What each version can refuse: of files, of TCP, of signals and abstract sockets.
_FILES = {1: 0x1FFF, 2: 0x3FFF, 3: 0x7FFF, 4: 0x7FFF, 5: 0xFFFF}
_TCP = 0b11
_TCP_SINCE = 4
_SCOPES = 0b11
_SCOPES_SINCE = 6
_OTHER_PACKAGES = {'site-packages', 'dist-packages'}


def ruleset_for(folder: Path) -> int:
    """Return the descriptor of a ruleset that allows to read `folder`, Python and NumPy.

    Nothing may be written but to /dev/null, and nothing connected to.
    """
    version = abi()
    attributes = pack(
        '=QQQ',
        _FILES[min(version, max(_FILES))],
        _TCP if version >= _TCP_SINCE else 0,
        _SCOPES if version >= _SCOPES_SINCE else 0,
    )
    ruleset = _landlock(_CREATE_RULESET, attributes, len(attributes), 0)
    library = Path(os.__file__).parent
    try:
        for path in (folder, *_python(library)):
            _allow(ruleset, path, _READ_FILE | _READ_DIR)
        _allow(ruleset, library, _READ_DIR)  # imports list it
        _allow(ruleset, Path(os.devnull), _READ_FILE | _WRITE_FILE)
    except BaseException:
        os.close(ruleset)
        raise
    return ruleset


def abi() -> int:
    """Return the version of the kernel's Landlock, from 1 on."""
    return _landlock(_CREATE_RULESET, None, 0, _VERSION)


def _allow(ruleset: int, path: Path, access: int) -> None:
    try:
        descriptor = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        if not stat.S_ISDIR(os.fstat(descriptor).st_mode):
            access &= ~_READ_DIR
        _landlock(_ADD_RULE, ruleset, _PATH_BENEATH, pack('=Qi', access, descriptor), 0)
    finally:
        os.close(descriptor)


def _landlock(number: int, *arguments: bytes | int | None) -> int:
    """Call the kernel; integers are pointers, sizes and flags."""
    wide = [ctypes.c_ulong(a) if isinstance(a, int) else a for a in arguments]
    result: int = ctypes.CDLL(None, use_errno=True).syscall(number, *wide)
    if result < 0:
        error = ctypes.get_errno()
        raise OSError(error, f'no Landlock here: {os.strerror(error)}')
    return result


@cache
def _python(library: Path) -> tuple[Path, ...]:
    """Return what Python and NumPy read: nothing of other packages, such as barc_sim itself.

    The folder of the standard library can contain other packages: its parts are named one by one.
    """
    parts = [path for path in library.iterdir() if path.name not in _OTHER_PACKAGES]
    extensions = Path(str(sysconfig.get_config_var('DESTSHARED') or library / 'lib-dynload'))
    numpy = package_folder('numpy')
    # Beside it, where NumPy came as a wheel, the libraries that it needs.
    return (*parts, extensions, numpy, numpy.with_name('numpy.libs'), *_shared_libraries())


@cache
def package_folder(name: str) -> Path:
    """Return the folder of an installed package."""
    spec: Any = importlib.util.find_spec(name)  # barc_sim needs it
    return Path(spec.submodule_search_locations[0]).resolve()


def _shared_libraries() -> list[Path]:
    """Return the shared libraries, file by file: on some systems their folders hold packages."""
    folders = {Path(sys.base_prefix, 'lib')}
    with Path('/proc/self/maps').open(encoding='utf-8', errors='replace') as maps:
        for line in maps:
            path = Path(line.split(maxsplit=5)[-1].rstrip())
            if path.name.startswith(('libc.', 'libc-', 'libm.', 'libstdc++.')):
                folders.add(path.parent)
    found = [path for folder in sorted(folders) for path in folder.glob('*.so*')]
    return [Path('/etc/ld.so.cache'), *found]


# Seccomp.
_KILL_PROCESS = 0x80000000
_ERRNO = 0x00050000
_ALLOW = 0x7FFF0000
_LOAD, _JUMP_IF_EQUAL, _RETURN, _AND = 0x20, 0x15, 0x06, 0x54
_NUMBER, _ARCHITECTURE, _ARGUMENTS = 0, 4, 16  # offsets in struct seccomp_data
# Before Linux 6.2 Landlock lets a file that may be read be emptied, unless the call asks to write.
_NO_MODE = O_WRONLY | O_RDWR  # neither to read nor to write; also the mask of the access modes
_EMPTYING = (O_RDONLY | O_TRUNC, _NO_MODE | O_TRUNC)
_FLAGS = {'open': 1, 'openat': 2}  # the argument with them
_TABLES = syscalls()
#: A younger architecture lacks some of them.
_ALLOWED = """
    read write close readv writev pread64 lseek access faccessat faccessat2 close_range
    stat fstat lstat newfstatat statx readlink readlinkat getcwd getdents64 dup dup2 dup3
    poll ppoll select pselect6
    brk mmap mprotect munmap mremap madvise
    rt_sigaction rt_sigprocmask rt_sigreturn sigaltstack
    exit exit_group futex set_robust_list rseq sched_yield sched_getaffinity
    nanosleep clock_nanosleep clock_gettime clock_getres gettimeofday time times setitimer
    getpid getppid gettid getuid geteuid getgid getegid getrlimit getrusage
    uname sysinfo getrandom
"""


#: The architectures: their names in the tables of system calls, and their numbers in seccomp_data.
MACHINES = {'x86_64': ('x86_64', 0xC000003E), 'aarch64': ('arm64', 0xC00000B7)}


def call_numbers(machine: str, calls: Iterable[str]) -> dict[str, int]:
    """Return the numbers of those system calls that a machine has."""
    found = {}
    for call in calls:
        with suppress(NotSupportedSystemCall):
            found[call] = int(_TABLES.get(call, MACHINES[machine][0]))
    return found


def call_filter(machine: str = '') -> bytes:
    """Return the filter for `machine`, by default this one, as an array of `sock_filter`."""
    machine = machine or platform.machine()
    if machine not in MACHINES:
        raise OSError(
            f'there is no filter of system calls for a {machine!r} machine, '
            f'only for {" and ".join(MACHINES)}'
        )
    return b''.join(
        [
            _instruction(_LOAD, _ARCHITECTURE),
            _instruction(_JUMP_IF_EQUAL, MACHINES[machine][1], if_equal=1),
            _instruction(_RETURN, _KILL_PROCESS),
            _instruction(_LOAD, _NUMBER),
            # As for a file that is no terminal.
            _instruction(_JUMP_IF_EQUAL, call_numbers(machine, ['ioctl'])['ioctl'], otherwise=1),
            _instruction(_RETURN, _ERRNO | ENOTTY),
            *_opening(machine),
            *_if_one_of([*call_numbers(machine, _ALLOWED.split()).values()]),
            _instruction(_RETURN, _ERRNO | EPERM),
            _instruction(_RETURN, _ALLOW),
        ]
    )


def _if_one_of(values: Sequence[int]) -> list[bytes]:
    """Return the instructions that skip the one after them if the value is one of `values`."""
    return [
        _instruction(_JUMP_IF_EQUAL, value, if_equal=len(values) - i)
        for i, value in enumerate(values)
    ]


def _opening(machine: str) -> list[bytes]:
    """Return the instructions that allow `open` and `openat`, except to empty files."""
    instructions = []
    for call, number in call_numbers(machine, _FLAGS).items():
        body = [
            _instruction(_LOAD, _ARGUMENTS + 8 * _FLAGS[call]),
            _instruction(_AND, _NO_MODE | O_TRUNC),
            *_if_one_of(_EMPTYING),
            _instruction(_RETURN, _ALLOW),
            _instruction(_RETURN, _ERRNO | EPERM),
        ]
        jump = _instruction(_JUMP_IF_EQUAL, number, otherwise=len(body))
        instructions += [jump, *body]
    return instructions


def _instruction(code: int, operand: int, *, if_equal: int = 0, otherwise: int = 0) -> bytes:
    """Return a `sock_filter`; the jumps are counted from the next instruction on."""
    return pack('=HBBI', code, if_equal, otherwise, operand)
