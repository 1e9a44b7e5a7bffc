"""The system calls that a confined process may make: a seccomp filter of the kernel.

All others fail with EPERM: new processes and threads, signals to anybody, sockets, ptrace,
io_uring, mounts, keys, and whatever later kernels bring. The libraries for this (pyseccomp) need
libseccomp from the system, which is not everywhere, for a program of some eighty instructions.
"""

from __future__ import annotations

import platform
from errno import ENOTTY, EPERM
from struct import pack
from typing import NamedTuple

_KILL_PROCESS = 0x80000000
_ERRNO = 0x00050000
_ALLOW = 0x7FFF0000

_LOAD, _JUMP_IF_EQUAL, _RETURN = 0x20, 0x15, 0x06
_NUMBER, _ARCHITECTURE, _ARGUMENTS = 0, 4, 16  # offsets in struct seccomp_data

# Only to duplicate and to look: F_SETOWN would have the kernel send signals to others.
_FCNTL_COMMANDS = (0, 1, 2, 3, 1030)  # F_DUPFD, F_GETFD, F_SETFD, F_GETFL, F_DUPFD_CLOEXEC


class Machine(NamedTuple):
    """An architecture's numbers."""

    audit: int  #: its name in seccomp_data
    allowed: tuple[int, ...]  #: system calls
    fcntl: int
    ioctl: int
    prlimit64: int


# read write close stat fstat lstat poll lseek mmap mprotect munmap brk rt_sigaction rt_sigprocmask
# rt_sigreturn pread64 readv writev access select sched_yield mremap madvise dup dup2 nanosleep
# getpid exit uname getcwd readlink gettimeofday getrlimit getrusage sysinfo times getuid getgid
# geteuid getegid getppid sigaltstack gettid time futex sched_getaffinity getdents64 clock_gettime
# clock_getres clock_nanosleep exit_group openat newfstatat readlinkat faccessat pselect6 ppoll
# set_robust_list dup3 getrandom statx rseq close_range faccessat2, and open
_X86_64 = Machine(
    audit=0xC000003E,
    allowed=(
        *(0, 1, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 17, 19, 20, 21, 23, 24, 25, 28, 32),
        *(33, 35, 39, 60, 63, 79, 89, 96, 97, 98, 99, 100, 102, 104, 107, 108, 110, 131, 186, 201),
        *(202, 204, 217, 228, 229, 230, 231, 257, 262, 267, 269, 270, 271, 273, 292, 318, 332, 334),
        *(436, 439, 2),
    ),
    fcntl=72,
    ioctl=16,
    prlimit64=302,
)
# The same, as far as this younger architecture has them.
_AARCH64 = Machine(
    audit=0xC00000B7,
    allowed=(
        *(17, 23, 24, 48, 56, 57, 61, 62, 63, 64, 65, 66, 67, 72, 73, 78, 79, 80, 93, 94, 98, 99),
        *(101, 113, 114, 115, 123, 124, 132, 134, 135, 139, 153, 160, 163, 165, 169, 172, 173, 174),
        *(175, 176, 177, 178, 179, 214, 215, 216, 222, 226, 233, 278, 291, 293, 436, 439),
    ),
    fcntl=25,
    ioctl=29,
    prlimit64=261,
)
MACHINES = {'x86_64': _X86_64, 'aarch64': _AARCH64}


def program(machine: Machine | None = None) -> bytes:
    """Return the filter for `machine`, this one unless given, as an array of `sock_filter`.

    Raises
    ------
    OSError
        where there is none for this machine.
    """
    machine = machine or MACHINES.get(platform.machine())
    if machine is None:
        raise OSError(
            f'no filter of system calls is known for a {platform.machine()!r} machine, '
            f'only for {" and ".join(MACHINES)}'
        )
    last = len(machine.allowed) - 1
    return b''.join(
        [
            _instruction(_LOAD, _ARCHITECTURE),
            _instruction(_JUMP_IF_EQUAL, machine.audit, if_equal=1),
            _instruction(_RETURN, _KILL_PROCESS),
            _instruction(_LOAD, _NUMBER),
            # As of a file that is no terminal.
            _instruction(_JUMP_IF_EQUAL, machine.ioctl, otherwise=1),
            _instruction(_RETURN, _ERRNO | ENOTTY),
            *_allowed_where(machine.fcntl, 8 * 1, _FCNTL_COMMANDS),
            # Limits may be looked at: the pointer to new ones is null, in both of its halves.
            *_allowed_where(machine.prlimit64, 8 * 2 + 4, (0,), and_also=8 * 2),
            *(
                _instruction(_JUMP_IF_EQUAL, number, if_equal=last - i + 1)
                for i, number in enumerate(machine.allowed)
            ),
            _instruction(_RETURN, _ERRNO | EPERM),
            _instruction(_RETURN, _ALLOW),
        ]
    )


def _allowed_where(
    call: int, offset: int, values: tuple[int, ...], and_also: int | None = None
) -> list[bytes]:
    """Return what decides over `call` by the argument at `offset`, leaving the others alone.

    Where `and_also` is given, the argument there has to be one of the values, too.
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


def _instruction(code: int, operand: int, *, if_equal: int = 0, otherwise: int = 0) -> bytes:
    """Return a `sock_filter`; the jumps are counted in instructions from the next one on."""
    return pack('=HBBI', code, if_equal, otherwise, operand)
