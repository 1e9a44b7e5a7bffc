"""Starts Python so that no file of the working directory decides what runs.

A command can be started in a folder that somebody else has written: `cd ada && barc grade .`. There
`python -c`, `python -m` and the workers of `multiprocessing` would import `ada/socket.py` in place
of Python's own module, with the rights of the user. `python -P` prevents that from Python 3.11 on,
and `python -I` would drop PYTHONPATH, in which a sourced ROS has its packages.
"""

from __future__ import annotations

import os
import sys
import sysconfig
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

_PACKAGES = Path(__file__).parents[2]
_ONLY_A_PLACE = getattr(os, 'O_PATH', os.O_RDONLY)  # of Linux: also for a folder that is unreadable
# Python 3.13 imports `linecache` before it runs the program of `-c`; `-P`, which 3.10 lacks, keeps
# it from the working directory.
_SAFE_PATH = ['-P'] if sys.version_info >= (3, 11) else []
# Before its path is set, the program imports only `sys`, which is compiled into Python.
_START = """\
import sys
sys.path[:] = sys.argv.pop(1).split({separator!r})
from runpy import run_module
run_module(sys.argv.pop(1), run_name='__main__', alter_sys=True)
"""


def python_command(module: str, *words: str) -> list[str]:
    """Return the command that does what `python -m MODULE WORD...` does, with our own path.

    Start it in a folder in which nobody else writes.
    """
    program = _START.format(separator=os.pathsep)
    path = os.pathsep.join(_without_working_directory(sys.path))
    return [sys.executable, *_SAFE_PATH, '-c', program, path, module, *words]


def ignore_working_directory() -> None:
    """Import nothing more from the working directory, and no settings of Matplotlib there."""
    sys.path[:] = _without_working_directory(sys.path)
    if os.path.lexists('matplotlibrc'):
        # Matplotlib reads its settings when it is imported, those of the working directory first.
        with working_in(_PACKAGES):
            import matplotlib  # noqa: F401, ICN001, PLC0415 (slow: not for each command)


@contextmanager
def working_in(folder: Path) -> Iterator[None]:
    """Make `folder` the working directory of the process within the block."""
    # A descriptor also leads back to a directory that was renamed or removed.
    has_descriptors = os.chdir in os.supports_fd
    before = os.open(os.curdir, _ONLY_A_PLACE) if has_descriptors else os.getcwd()  # noqa: PTH109

    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)
        if isinstance(before, int):
            os.close(before)


def _without_working_directory(path: list[str]) -> list[str]:
    """Return a path of imports without the working directory, unless Python itself is there."""
    try:
        here = os.path.realpath(os.curdir)
    except OSError:  # it has been removed: nothing can be imported from it
        return path

    entries = [os.path.abspath(entry) for entry in path]  # noqa: PTH100 (it also takes '')
    python_folders = [str(_PACKAGES), *sysconfig.get_paths().values()]
    if here in [os.path.realpath(folder) for folder in python_folders]:
        return entries
    return [entry for entry in entries if os.path.realpath(entry) != here]
