"""What Linux lets a confined process do: the files that it may read, and its system calls.

Landlock, the kernel's own sandbox, refuses files, TCP, signals and abstract sockets. A seccomp
filter refuses all system calls but those below, with EPERM: new processes and threads, signals,
sockets, ptrace, io_uring, mounts, keys, and the calls of later kernels. What the kernel lacks or
refuses is an OSError.

Both are written by hand. The library landlock on PyPI has had only development releases since 2022,
and refuses neither networks nor signals; those for seccomp (pyseccomp, for one) need libseccomp
from the system, which is not on every machine.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import platform
import stat
import sys
import sysconfig
from contextlib import suppress
from errno import ENOTTY, EPERM
from functools import cache
from os import O_RDONLY, O_RDWR, O_TRUNC, O_WRONLY
from pathlib import Path
from struct import pack
from typing import TYPE_CHECKING

from system_calls import NotSupportedSystemCall, syscalls

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

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
    spec = importlib.util.find_spec(name)
    assert spec  # noqa: S101 (barc_sim needs it)
    assert spec.submodule_search_locations  # noqa: S101 (it is a package)
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


def numbers(machine: str, calls: Iterable[str]) -> dict[str, int]:
    """Return the numbers of those system calls that a machine has."""
    found = {}
    for call in calls:
        with suppress(NotSupportedSystemCall):
            found[call] = int(_TABLES.get(call, MACHINES[machine][0]))
    return found


def program(machine: str = '') -> bytes:
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
            _instruction(_JUMP_IF_EQUAL, numbers(machine, ['ioctl'])['ioctl'], otherwise=1),
            _instruction(_RETURN, _ERRNO | ENOTTY),
            *_opening(machine),
            *_if_one_of([*numbers(machine, _ALLOWED.split()).values()]),
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
    for call, number in numbers(machine, _FLAGS).items():
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
