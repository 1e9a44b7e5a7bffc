"""The system calls that a confined process may make: a seccomp filter of the kernel.

All other calls fail with EPERM: new processes and threads, signals, sockets, ptrace, io_uring,
mounts, keys, and the calls of later kernels. The program itself is written by hand: the libraries
for it (pyseccomp, for one) need libseccomp from the system, which is not on every machine.
"""

from __future__ import annotations

import platform
from contextlib import suppress
from errno import ENOTTY, EPERM
from os import O_RDONLY, O_RDWR, O_TRUNC, O_WRONLY
from struct import pack
from typing import NamedTuple

from system_calls import NotSupportedSystemCall, syscalls

_KILL_PROCESS = 0x80000000
_ERRNO = 0x00050000
_ALLOW = 0x7FFF0000

_LOAD, _JUMP_IF_EQUAL, _RETURN, _AND = 0x20, 0x15, 0x06, 0x54
_NUMBER, _ARCHITECTURE, _ARGUMENTS = 0, 4, 16  # offsets in struct seccomp_data

# Only to duplicate and to read: with F_SETOWN the kernel would send signals to other processes.
_FCNTL_COMMANDS = (0, 1, 2, 3, 1030)  # F_DUPFD, F_GETFD, F_SETFD, F_GETFL, F_DUPFD_CLOEXEC

# Before Linux 6.2 Landlock lets a file that may be read be emptied, unless the call asks to write.
_NO_MODE = O_WRONLY | O_RDWR  # neither to read nor to write; also the mask of the access modes
_EMPTYING = (O_RDONLY | O_TRUNC, _NO_MODE | O_TRUNC)

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


class Machine(NamedTuple):
    """A processor architecture."""

    name: str  #: in the tables of system calls
    audit: int  #: in struct seccomp_data

    def number(self, call: str) -> int:
        """Return the number of the system call named `call`.

        Raises
        ------
        NotSupportedSystemCall
            if the architecture lacks it.
        """
        return int(_TABLES.get(call, self.name))

    def allowed(self) -> list[int]:
        """Return the numbers of the system calls that are always allowed."""
        numbers = []
        for call in _ALLOWED.split():
            with suppress(NotSupportedSystemCall):
                numbers.append(self.number(call))
        return numbers


MACHINES = {'x86_64': Machine('x86_64', 0xC000003E), 'aarch64': Machine('arm64', 0xC00000B7)}


def program(machine: Machine | None = None) -> bytes:
    """Return the filter for `machine` (default: this one) as an array of `sock_filter`.

    Raises
    ------
    OSError
        if this machine has another architecture.
    """
    machine = machine or MACHINES.get(platform.machine())
    if machine is None:
        raise OSError(
            f'there is no filter of system calls for a {platform.machine()!r} machine, '
            f'only for {" and ".join(MACHINES)}'
        )
    allowed = machine.allowed()
    return b''.join(
        [
            _instruction(_LOAD, _ARCHITECTURE),
            _instruction(_JUMP_IF_EQUAL, machine.audit, if_equal=1),
            _instruction(_RETURN, _KILL_PROCESS),
            _instruction(_LOAD, _NUMBER),
            # As for a file that is no terminal.
            _instruction(_JUMP_IF_EQUAL, machine.number('ioctl'), otherwise=1),
            _instruction(_RETURN, _ERRNO | ENOTTY),
            *_allowed_where(machine.number('fcntl'), 8 * 1, _FCNTL_COMMANDS),
            # Limits can be read: the pointer to new ones is null, in both of its halves.
            *_allowed_where(machine.number('prlimit64'), 8 * 2 + 4, (0,), and_also=8 * 2),
            *_opening(machine),
            *(
                _instruction(_JUMP_IF_EQUAL, number, if_equal=len(allowed) - i)
                for i, number in enumerate(allowed)
            ),
            _instruction(_RETURN, _ERRNO | EPERM),
            _instruction(_RETURN, _ALLOW),
        ]
    )


def _allowed_where(
    call: int, offset: int, values: tuple[int, ...], and_also: int | None = None
) -> list[bytes]:
    """Return the instructions that allow `call` if its argument at `offset` is one of `values`.

    The argument at `and_also`, if given, must be one of them, too.
    """
    loads = [offset] if and_also is None else [offset, and_also]
    body: list[bytes] = []
    for at in loads:
        body.append(_instruction(_LOAD, _ARGUMENTS + at))
        body += [
            _instruction(_JUMP_IF_EQUAL, value, if_equal=len(values) - i)
            for i, value in enumerate(values)
        ]
        body.append(_instruction(_RETURN, _ERRNO | EPERM))
    body.append(_instruction(_RETURN, _ALLOW))
    return [_instruction(_JUMP_IF_EQUAL, call, otherwise=len(body)), *body]


def _opening(machine: Machine) -> list[bytes]:
    """Return the instructions that allow `open` and `openat`, except to empty files."""
    instructions = []
    for call, flags in (('open', 1), ('openat', 2)):
        with suppress(NotSupportedSystemCall):
            body = [
                _instruction(_LOAD, _ARGUMENTS + 8 * flags),
                _instruction(_AND, _NO_MODE | O_TRUNC),
                *(
                    _instruction(_JUMP_IF_EQUAL, value, if_equal=len(_EMPTYING) - i)
                    for i, value in enumerate(_EMPTYING)
                ),
                _instruction(_RETURN, _ALLOW),
                _instruction(_RETURN, _ERRNO | EPERM),
            ]
            jump = _instruction(_JUMP_IF_EQUAL, machine.number(call), otherwise=len(body))
            instructions += [jump, *body]
    return instructions


def _instruction(code: int, operand: int, *, if_equal: int = 0, otherwise: int = 0) -> bytes:
    """Return a `sock_filter`; the jumps are counted from the next instruction on."""
    return pack('=HBBI', code, if_equal, otherwise, operand)
