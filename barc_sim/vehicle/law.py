"""Laws: functions of records, written once, that Python runs and Numba compiles.

A law of physics or control is a plain function of numbers, NamedTuples and arrays, with Python's
`math`. A single run calls it as it is. A loop over thousands of runs is compiled together with the
laws that it calls, where Numba is installed (`pip install 'barc_sim[fast]'`), and gives the same
numbers to the last bit: Numba keeps the order of operations, and calls the C library's functions,
as Python does. `math.hypot` is an exception, which Python computes in a way of its own: a law takes
the square root.

Numba is imported when the first loop is compiled. Compiled code is kept in the user's cache folder,
in a folder for these sources and versions: a changed law is never run from there.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import platform
import shutil
import sys
import time
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeVar, cast

if TYPE_CHECKING:
    from collections.abc import Callable

    _Function = TypeVar('_Function', bound=Callable[..., Any])

_KEPT = 30 * 24 * 3600.0  #: [s] for which compiled code is kept after its last use
_laws: list[Callable[..., Any]] = []
_registering = Lock()  #: of `_laws`: several threads can compile loops at once


def law(function: _Function) -> _Function:
    """Declare a function to be a law, which compiled loops and other laws can call.

    It stays as it is in Python.
    """
    _laws.append(function)
    return function


def is_compiled() -> bool:
    """Return whether Numba is installed, so that loops over many runs are compiled."""
    return find_spec('numba') is not None


def must_compile(loop: Callable[..., Any]) -> bool:
    """Return whether a loop is compiled before its next run, which takes some seconds."""
    if not is_compiled():
        return False
    folder = _cache_folder()
    return folder is None or not any(folder.rglob(f'*.{loop.__qualname__}-*.nbi'))


@cache
def compiled(loop: _Function) -> _Function:
    """Return a loop over many runs, compiled with the laws that it calls.

    Without Numba it is the loop itself. A compiled loop releases the interpreter's lock, so that
    threads share the cores. A line in the terminal says that its first run takes longer.
    """
    if not is_compiled():
        return loop
    if sys.stderr.isatty() and must_compile(loop):
        announce()
    import numba  # noqa: PLC0415 (0.2 s, which a single run does not need)
    from numba.extending import register_jitable  # noqa: PLC0415

    with _registering:
        while _laws:
            # Inlined, records of numbers stay in registers. Nothing is allocated in a law, so that
            # the arrays of a record need no references counted, which takes longer than most laws.
            register_jitable(forceinline=True, _nrt=False)(_laws.pop())
    folder = _cache_folder()
    if folder:
        numba.config.CACHE_DIR = str(folder)
    return cast('_Function', numba.njit(nogil=True, cache=folder is not None)(loop))


def compiled_for(loop: _Function, *arguments: object) -> _Function:
    """Return a loop over many runs as `compiled` does, for arguments of the types of these alone.

    A call of it does not find out the types of its arguments: with large records, that takes longer
    than a step of a hundred cars.
    """
    dispatcher: Any = compiled(loop)
    if not is_compiled():
        return loop
    import numba  # noqa: PLC0415 (as in `compiled`)

    types = tuple(numba.typeof(argument) for argument in arguments)
    return cast('_Function', dispatcher.compile(types))


@cache
def announce() -> None:
    """Print, once in a process, that laws are compiled."""
    print('Compiling the laws takes some seconds, once.', file=sys.stderr)  # noqa: T201


def _cache_folder() -> Path | None:
    """Return the folder of compiled code, of these sources and versions; None: there is none."""
    caches = Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache') / 'barc_sim'
    folder = caches / f'compiled-{_fingerprint()}'
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        os.utime(folder)  # which says when it was used last
    except OSError:
        return None
    if not os.access(folder, os.W_OK):
        return None
    _remove_unused(caches)
    return folder


def _remove_unused(caches: Path) -> None:
    """Remove the compiled code of other sources that nothing has used for `_KEPT` seconds."""
    for folder in caches.glob('compiled-*'):
        with suppress(OSError):  # another process removes it, too
            if time.time() - folder.stat().st_mtime > _KEPT:
                shutil.rmtree(folder)


def _fingerprint() -> str:
    """Return a text that changes with any source that can hold a law, and with its compiler."""
    digest = hashlib.sha256()
    for text in (sys.version, platform.machine(), version('numba'), version('numpy')):
        digest.update(text.encode())
    package = Path(inspect.getfile(law)).parents[1]
    for path in sorted(package.rglob('*.py')):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
