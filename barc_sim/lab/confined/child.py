"""The process of a submission: it confines itself, then calls functions for requests.

None of the submission's code runs before `_confine`: `UserCode` loads a file at the first request
that needs it, and requests are read only after `_confine`. Until then the process has imported only
Python's own modules, NumPy, barc_sim, and the packages that barc_sim needs for this.

`process.py` starts this script without site-packages and with an empty environment. Landlock, the
kernel's own sandbox, refuses files, TCP, signals and abstract sockets. A seccomp filter refuses all
system calls except those listed below, with EPERM: so also new processes and threads, signals,
sockets, ptrace, io_uring, mounts, keys, and the calls of later kernels. A feature that the kernel
lacks or refuses raises an OSError. Landlock and seccomp are used without a library: landlock on
PyPI has had only development releases since 2022, and refuses neither networks nor signals; those
for seccomp, such as pyseccomp, need the system's libseccomp, which not every machine has.

Requests and replies are lines of JSON: `{"serial": 1, "do": NAME, "arguments": […]}` gets
`{"serial": 1, "result": …}` or `{"serial": 1, "error": TEXT, "kind": KIND}`; the kinds are
`ErrorKind` of `files.py`. The first reply has the serial 0 and
no request: it reports that the process is confined. NAME is an attribute of `UserCode`; each name
also has the shape of its result in `RESULTS` of `replies.py`:

==============  ===========================================  ===============================
do              arguments                                    result
==============  ===========================================  ===============================
functions       function, rows, fresh, corrected             a result for each row
make            class, number of the object, gains or track  none; the object is kept
steps           class, number of the object, rows            an output for each row, in turn
relay_commands  Twists, duration, calls                      the commands of a relay
lines           do, and its arguments                        the lines that assign numbers
notes                                                        chosen gains, tolerated faults
name                                                         the `NAME` in `identify.py`
==============  ===========================================  ===============================

The process has no score, no rubric and no law of the vehicle or of control, so a submission that
reads or changes it can only change its own results.
"""

from __future__ import annotations

import ctypes
import json
import os
import platform
import random
import signal
import stat
import sys
import sysconfig
import time
from contextlib import suppress
from errno import ENOTTY, EPERM
from itertools import count
from os import O_RDONLY, O_RDWR, O_TRUNC, O_WRONLY
from pathlib import Path
from struct import pack
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from types import FrameType


MAX_TEXT = 4000  #: characters of an error; a longer one is cut
NO_PIPES = 97  #: exit code of a process whose pipes have been closed
# Options of prctl, the mode of a filter, and the system call of Landlock.
_SET_PDEATHSIG = 1
_SET_DUMPABLE = 4
_SET_SECCOMP = 22
_SET_NO_NEW_PRIVS = 38
_MODE_FILTER = 2
_RESTRICT_SELF = 446
_INSTRUCTION = 8  # bytes of a seccomp program
_FIRST_TIME = 10**18  # [ns] of the clock that user code reads
_TICK = 1000  # [ns] from one reading of it to the next


def _handler(seconds: float) -> Callable[..., Any]:
    """Return the function that answers requests, for the files of the current folder.

    A request that uses more than `seconds` of processor time raises OutOfTime, which names the
    line. The grader kills code that catches it, or that does not return to Python.
    """
    from barc_sim.lab.files import files_in  # noqa: PLC0415
    from barc_sim.lab.user_code.code import UserCode  # noqa: PLC0415
    from barc_sim.lab.user_code.folder import OutOfTime  # noqa: PLC0415

    files = files_in(Path())
    if 'relay' in files:
        from barc_sim.lab.user_code import relay_program  # noqa: PLC0415

        relay_program.prepare()

    _seed_generators()

    code = UserCode(files, is_judged=True)  # loads no file yet: the process is not confined
    code.drop_writes()  # so that `check`, which is not confined, writes nothing either

    has_alarms = hasattr(signal, 'setitimer')  # not on Windows: the grader ends the process

    def set_alarm(seconds: float) -> None:
        if has_alarms:
            signal.setitimer(signal.ITIMER_PROF, seconds)

    def out_of_time(_: int, __: FrameType | None) -> None:
        raise OutOfTime

    def handle(do: str, *arguments: Any) -> Any:  # noqa: ANN401 (JSON)
        set_alarm(seconds)
        try:
            attribute = getattr(code, do)
            return attribute(*arguments) if callable(attribute) else attribute
        finally:
            set_alarm(0.0)
            sys.settrace(None)

    OutOfTime.seconds = seconds
    if has_alarms:
        signal.signal(signal.SIGPROF, out_of_time)
    return handle


def _seed_generators() -> None:
    """Give random numbers without a seed, and the time, the same values in each process.

    Otherwise the same file would get other points. Python's generators and NumPy's take their seeds
    from `os.urandom`, except for `random.Random`, or from the user's `time.time()`. A seed that the
    user chooses counts.
    """
    source = random.Random(0)  # noqa: S311 (a simulation, not a secret)
    os.urandom = source.randbytes

    set_seed: Any = random.Random.seed

    def seed(generator: random.Random, a: Any = None, version: int = 2) -> None:  # noqa: ANN401
        set_seed(generator, source.getrandbits(64) if a is None else a, version)

    generators: Any = random
    generators._urandom = source.randbytes  # noqa: SLF001
    generators.Random.seed = seed
    generators.seed = generators._inst.seed  # noqa: SLF001 (the functions of the module use it)

    # It goes on with each call, so that a loop that waits for a time ends.
    nanoseconds = count(_FIRST_TIME, _TICK)
    time.time_ns = lambda: next(nanoseconds)
    time.time = lambda: next(nanoseconds) / 1e9


def _forget_packages(path: list[str]) -> None:
    """Prevent further imports of barc_sim's modules, and of packages installed beside it."""
    sys.path[:] = path
    for name, module in [*sys.modules.items()]:
        package = name.partition('.')[0]
        if package == 'system_calls':  # no longer needed: the filter is made
            del sys.modules[name]
        elif package == 'barc_sim' and hasattr(module, '__path__'):
            module.__path__ = []
    sys.path_importer_cache.clear()


def _limit(memory: int, parent: int) -> None:
    """Limit memory [bytes] and files; end with the process `parent`."""
    import resource  # noqa: PLC0415 (not on Windows)

    _call_c('prctl', _SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)  # the parent ended before prctl
    _call_c('prctl', _SET_DUMPABLE, 0, 0, 0, 0)

    limits = {
        resource.RLIMIT_AS: memory,
        resource.RLIMIT_FSIZE: 0,
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_NOFILE: 64,
        resource.RLIMIT_NPROC: 0,
    }
    for kind, amount in limits.items():
        # An existing hard limit that is lower stays.
        hard = resource.getrlimit(kind)[1]
        lower = amount if hard == resource.RLIM_INFINITY else min(amount, hard)
        resource.setrlimit(kind, (lower, lower))


def _confine(ruleset: int, program: bytes) -> None:
    """Allow only the files of a Landlock `ruleset`, and the system calls of a seccomp `program`."""
    _call_c('prctl', _SET_NO_NEW_PRIVS, 1, 0, 0, 0)
    _landlock(_RESTRICT_SELF, ruleset, 0)
    os.close(ruleset)

    buffer = ctypes.create_string_buffer(program, len(program))
    filter_program = _FilterProgram(len(program) // _INSTRUCTION, ctypes.addressof(buffer))
    _call_c('prctl', _SET_SECCOMP, _MODE_FILTER, ctypes.addressof(filter_program), 0, 0)


class _FilterProgram(ctypes.Structure):
    _fields_ = (('length', ctypes.c_ushort), ('filter', ctypes.c_void_p))


def _landlock(number: int, *arguments: bytes | int | None) -> int:
    """Make a system call of Landlock; an OSError if the kernel has none."""
    try:
        return _call_c('syscall', number, *arguments)
    except OSError as error:
        raise OSError(error.errno, f'no Landlock here: {error.strerror}') from None


def _call_c(function: str, number: int, *arguments: bytes | int | None) -> int:
    """Call a function of the C library; integers are passed as unsigned long."""
    wide = [ctypes.c_ulong(each) if isinstance(each, int) else each for each in arguments]
    result: int = getattr(ctypes.CDLL(None, use_errno=True), function)(number, *wide)
    if result < 0:
        error = ctypes.get_errno()
        raise OSError(error, f'{function} {number} failed: {os.strerror(error)}')
    return result


# Landlock. Its calls have the same numbers on all architectures.
_CREATE_RULESET = 444
_ADD_RULE = 445
_VERSION = 1
_PATH_BENEATH = 1
_WRITE_FILE = 1 << 1
_READ_FILE = 1 << 2
_READ_DIR = 1 << 3
# The rights that each version can refuse: on files, on TCP, and (scopes) on signals and sockets.
_FILES = {1: 0x1FFF, 2: 0x3FFF, 3: 0x7FFF, 4: 0x7FFF, 5: 0xFFFF}
_TCP = 0b11
_TCP_SINCE = 4
_SCOPES = 0b11
_SCOPES_SINCE = 6
_OTHER_PACKAGES = {'site-packages', 'dist-packages'}


def _ruleset(folder: Path, numpy: Path, version: int) -> int:
    """Return the descriptor of a ruleset that allows reading `folder`, Python and NumPy.

    It allows writing only to /dev/null, and no connections. It uses all that this `version` of
    Landlock has.
    """
    attributes = pack(
        '=QQQ',
        _FILES[min(version, max(_FILES))],
        _TCP if version >= _TCP_SINCE else 0,
        _SCOPES if version >= _SCOPES_SINCE else 0,
    )
    ruleset = _landlock(_CREATE_RULESET, attributes, len(attributes), 0)
    library = Path(os.__file__).parent
    try:
        for path in (folder, numpy, numpy.with_name('numpy.libs'), *_python(library)):
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


def _python(library: Path) -> list[Path]:
    """Return the paths that Python reads, without other packages, such as barc_sim itself.

    The folder of the standard library can contain other packages, so its parts are listed.
    """
    parts = [path for path in library.iterdir() if path.name not in _OTHER_PACKAGES]
    extensions = Path(str(sysconfig.get_config_var('DESTSHARED') or library / 'lib-dynload'))
    return [*parts, extensions, *_shared_libraries()]


def _shared_libraries() -> list[Path]:
    """Return the shared libraries, file by file: some systems have packages in their folders."""
    folders = {Path(sys.base_prefix, 'lib')}
    with Path('/proc/self/maps').open(encoding='utf-8', errors='replace') as maps:
        for line in maps:
            path = Path(line.split(maxsplit=5)[-1].rstrip())
            if path.name.startswith(('libc.', 'libc-', 'libm.', 'libstdc++.')):
                folders.add(path.parent)
    libraries = [path for folder in sorted(folders) for path in folder.glob('*.so*')]
    return [Path('/etc/ld.so.cache'), *libraries]


# Seccomp.
_KILL_PROCESS = 0x80000000
_ERRNO = 0x00050000
_ALLOW = 0x7FFF0000
# Instructions.
_LOAD = 0x20
_JUMP_IF_EQUAL = 0x15
_RETURN = 0x06
_AND = 0x54
# Offsets in struct seccomp_data.
_NUMBER = 0
_ARCHITECTURE = 4
_ARGUMENTS = 16
# Before Linux 6.2, Landlock lets O_TRUNC empty a readable file that is not opened for writing.
_NO_MODE = O_WRONLY | O_RDWR  # neither reading nor writing; also the mask of the access modes
_EMPTYING = (O_RDONLY | O_TRUNC, _NO_MODE | O_TRUNC)
_FLAGS = {'open': 1, 'openat': 2}  # the position of the flags among the arguments
#: The allowed system calls; a newer architecture lacks some of them.
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
    """Return the numbers of these system calls on a machine, without those that it lacks."""
    from system_calls import NotSupportedSystemCall, syscalls  # noqa: PLC0415 (no site-packages yet)

    tables = syscalls()
    numbers = {}
    for call in calls:
        with suppress(NotSupportedSystemCall):
            numbers[call] = int(tables.get(call, MACHINES[machine][0]))
    return numbers


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
            # ioctl fails as for a file that is not a terminal.
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


def _answer(handler: Callable[..., Any], serial: int, do: str, arguments: list[Any]) -> bytes:
    reply: dict[str, Any] = {'serial': serial}
    try:
        data = json.dumps(reply | {'result': handler(do, *arguments)})
    except BaseException as error:  # noqa: BLE001 (SystemExit, too: a submission can raise it)
        data = json.dumps(reply | {'error': _text(error), 'kind': _kind(error)})
    return data.encode() + b'\n'


def _text(error: BaseException) -> str:
    try:
        # Errors of barc_sim are whole sentences; for other exceptions the type is added.
        text = str(error) if _is_ours(error) else f'{type(error).__name__}: {error}'
        return text[:MAX_TEXT]
    except BaseException:  # noqa: BLE001 (str() can run the submission's code)
        return 'an exception that cannot be printed'


def _kind(error: BaseException) -> str:
    """Return the kind of a `UserCodeError`; empty for any other exception."""
    kind = getattr(error, 'kind', None) if _is_ours(error) else None
    return str(kind.value) if kind else ''


def _is_ours(error: BaseException) -> bool:
    """Return whether barc_sim defines the class of an exception."""
    return type(error).__module__.startswith('barc_sim.')


def _serve(handler: Callable[..., Any], requests: int, replies: int) -> None:
    """Answer requests until they end."""
    with open(requests, 'rb') as lines, open(replies, 'wb', buffering=0) as out:
        out.write(b'{"serial": 0, "result": null}\n')
        for line in lines:
            data = _answer(handler, **json.loads(line))
            while data:
                data = data[out.write(data) or 0 :]


def _main() -> None:
    start = json.loads(sys.argv.pop())
    sys.path.pop(0)  # the script's own folder

    # So that a submission cannot read requests or print replies by stdin and stdout.
    requests = os.dup(0)
    replies = os.dup(1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)

    try:
        path = [*sys.path]
        sys.path += start['packages']
        import numpy  # noqa: ICN001, PLC0415 (the only package that a submission may import)

        handler = _handler(start['call'])
        ruleset = 0
        program = b''
        if start['landlock']:
            package = Path(numpy.__file__).resolve().parent
            ruleset = _ruleset(Path(), package, start['landlock'])
            program = call_filter()

        _forget_packages(path)
        if sys.platform == 'linux':
            _limit(start['memory'], start['parent'])
        if start['landlock']:
            _confine(ruleset, program)
    except Exception as error:  # noqa: BLE001 (the grader prints it)
        os.write(replies, json.dumps({'serial': 0, 'error': _text(error)}).encode() + b'\n')
        sys.exit(1)

    try:
        _serve(handler, requests, replies)
    except (OSError, ValueError):
        # The submission has closed the pipes, or the grader has ended.
        os._exit(NO_PIPES)


if __name__ == '__main__':
    _main()
