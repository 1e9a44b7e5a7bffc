"""What a confined process may do: files by Landlock, system calls by seccomp, limits.

Landlock is the kernel's own sandbox. Its calls are written by hand because the one library for it
(landlock) has had only development releases since 2022, and supports neither networks nor signals.
They have the same numbers on all architectures. What the kernel lacks or refuses is an OSError.
"""

from __future__ import annotations

import ctypes
import os
import signal
import stat
from struct import pack
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

_SET_PDEATHSIG, _SET_DUMPABLE, _SET_SECCOMP, _SET_NO_NEW_PRIVS = 1, 4, 22, 38
_MODE_FILTER = 2
_INSTRUCTION = 8  # bytes

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_VERSION = 1
_PATH_BENEATH = 1

_WRITE_FILE, _READ_FILE, _READ_DIR = 1 << 1, 1 << 2, 1 << 3
# What each version of Landlock can refuse: of files, of TCP, of signals and abstract sockets.
_FILES = {1: 0x1FFF, 2: 0x3FFF, 3: 0x7FFF, 4: 0x7FFF, 5: 0xFFFF}
_TCP = 0b11
_TCP_SINCE = 4
_SCOPES = 0b11
_SCOPES_SINCE = 6


def create_ruleset(
    readable: Iterable[Path], listable: Iterable[Path] = (), writable: Iterable[Path] = ()
) -> int:
    """Return the descriptor of a ruleset that allows only the named files, and no connection.

    Parameters
    ----------
    readable
        Files, and folders with their contents. Missing ones are ignored.
    listable
        Folders whose list of names may be read, but not their files.
    writable
        Files that may be written to, and read.
    """
    version = abi()
    attributes = pack(
        '=QQQ',
        _FILES[min(version, max(_FILES))],
        _TCP if version >= _TCP_SINCE else 0,
        _SCOPES if version >= _SCOPES_SINCE else 0,
    )
    ruleset = _landlock(_CREATE_RULESET, attributes, len(attributes), 0)
    try:
        for path in readable:
            _allow(ruleset, path, _READ_FILE | _READ_DIR)
        for path in listable:
            _allow(ruleset, path, _READ_DIR)
        for path in writable:
            _allow(ruleset, path, _READ_FILE | _WRITE_FILE)
    except BaseException:
        os.close(ruleset)
        raise
    return ruleset


def abi() -> int:
    """Return the version of the kernel's Landlock, from 1 on."""
    return _landlock(_CREATE_RULESET, None, 0, _VERSION)


def limit_resources(memory: int, cpu: int, parent: int) -> None:
    """Limit memory [bytes], processor time [s] and files; end with the process `parent`."""
    import resource  # noqa: PLC0415 (not on Windows)

    _prctl(_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        # It has already ended.
        os._exit(1)
    _prctl(_SET_DUMPABLE, 0)
    for kind, amount in (
        (resource.RLIMIT_AS, memory),
        (resource.RLIMIT_CPU, cpu),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_CORE, 0),
        (resource.RLIMIT_NOFILE, 64),
        (resource.RLIMIT_NPROC, 0),
    ):
        # A lower hard limit stays.
        hard = resource.getrlimit(kind)[1]
        amount = amount if hard == resource.RLIM_INFINITY else min(amount, hard)  # noqa: PLW2901
        resource.setrlimit(kind, (amount, amount))


def confine(ruleset: int, program: bytes) -> None:
    """Allow only the files of a Landlock `ruleset`, and the system calls of a seccomp `program`."""
    _prctl(_SET_NO_NEW_PRIVS, 1)
    _landlock(_RESTRICT_SELF, ruleset, 0)
    os.close(ruleset)
    buffer = ctypes.create_string_buffer(program, len(program))
    filter_program = _FilterProgram(len(program) // _INSTRUCTION, ctypes.addressof(buffer))
    _prctl(_SET_SECCOMP, _MODE_FILTER, ctypes.addressof(filter_program))


class _FilterProgram(ctypes.Structure):
    _fields_ = (('length', ctypes.c_ushort), ('filter', ctypes.c_void_p))


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
    return _called('syscall', number, *arguments, fault='no Landlock here')


def _prctl(option: int, *arguments: int) -> None:
    rest = (0,) * (4 - len(arguments))
    _called('prctl', option, *arguments, *rest, fault=f'prctl {option} failed')


def _called(function: str, number: int, *arguments: bytes | int | None, fault: str) -> int:
    """Call a function of the C library; its integers are pointers, sizes and flags."""
    wide = [ctypes.c_ulong(a) if isinstance(a, int) else a for a in arguments]
    result: int = getattr(ctypes.CDLL(None, use_errno=True), function)(number, *wide)
    if result < 0:
        error = ctypes.get_errno()
        raise OSError(error, f'{fault}: {os.strerror(error)}')
    return result
