"""Which files a confined process may read: the rules of Landlock, the kernel's own sandbox.

Its calls are written by hand because the one library for it (landlock) has had only development
releases since 2022, and supports neither networks nor signals. They have the same numbers on all
architectures. What the kernel lacks or refuses is an OSError.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import stat
import sys
import sysconfig
from functools import cache
from pathlib import Path
from struct import pack
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

_CREATE_RULESET, _ADD_RULE = 444, 445
_VERSION = 1
_PATH_BENEATH = 1

_WRITE_FILE, _READ_FILE, _READ_DIR = 1 << 1, 1 << 2, 1 << 3
# What each version of Landlock can refuse: of files, of TCP, of signals and abstract sockets.
_FILES = {1: 0x1FFF, 2: 0x3FFF, 3: 0x7FFF, 4: 0x7FFF, 5: 0xFFFF}
_TCP = 0b11
_TCP_SINCE = 4
_SCOPES = 0b11
_SCOPES_SINCE = 6
_OTHER_PACKAGES = {'site-packages', 'dist-packages'}


def ruleset_for(folder: Path) -> int:
    """Return the descriptor of a ruleset that allows to read `folder`, Python and NumPy."""
    readable, listable = _python()
    return create_ruleset((folder, *readable), listable, (Path(os.devnull),))


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
def _python() -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """Return what Python and NumPy read, and the folders that they list.

    Nothing is of other packages, such as barc_sim itself. The folder of the standard library can
    contain other packages, so its parts are named one by one; imports list it.
    """
    library = Path(os.__file__).parent
    parts = [path for path in library.iterdir() if path.name not in _OTHER_PACKAGES]
    extensions = Path(str(sysconfig.get_config_var('DESTSHARED') or library / 'lib-dynload'))
    numpy = package_folder('numpy')
    # Beside it, where NumPy came as a wheel, the libraries that it needs.
    libraries = (numpy.with_name('numpy.libs'), *_shared_libraries())
    return (*parts, extensions, numpy, *libraries), (library,)


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
