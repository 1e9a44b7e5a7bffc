"""The files that a confined process may read: a ruleset of Landlock, the kernel's own sandbox.

Written by hand because the one library for it (landlock) has had only development releases since
2022, and supports neither networks nor signals. Its three system calls have the same numbers on
all architectures.
"""

from __future__ import annotations

import ctypes
import os
import stat
from struct import pack
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

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

    Raises
    ------
    OSError
        if the kernel has no Landlock.
    """
    version = abi()
    attributes = pack(
        '=QQQ',
        _FILES[min(version, max(_FILES))],
        _TCP if version >= _TCP_SINCE else 0,
        _SCOPES if version >= _SCOPES_SINCE else 0,
    )
    ruleset = _call(_CREATE_RULESET, attributes, len(attributes), 0)
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
    """Return the version of the kernel's Landlock, from 1 on.

    Raises
    ------
    OSError
        if the kernel has none.
    """
    return _call(_CREATE_RULESET, None, 0, _VERSION)


def restrict_self(ruleset: int) -> None:
    """Apply the ruleset to this thread, and all that it starts, for ever.

    Raises
    ------
    OSError
        if the kernel refuses, as without PR_SET_NO_NEW_PRIVS.
    """
    _call(_RESTRICT_SELF, ruleset, 0)


def _allow(ruleset: int, path: Path, access: int) -> None:
    try:
        descriptor = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        if not stat.S_ISDIR(os.fstat(descriptor).st_mode):
            access &= ~_READ_DIR
        _call(_ADD_RULE, ruleset, _PATH_BENEATH, pack('=Qi', access, descriptor), 0)
    finally:
        os.close(descriptor)


def _call(number: int, *arguments: bytes | int | None) -> int:
    """Make a system call; its integers are descriptors, sizes and flags, all positive."""
    wide = [ctypes.c_ulong(a) if isinstance(a, int) else a for a in arguments]
    result: int = ctypes.CDLL(None, use_errno=True).syscall(number, *wide)
    if result < 0:
        error = ctypes.get_errno()
        raise OSError(error, f'no Landlock here: {os.strerror(error)}')
    return result
