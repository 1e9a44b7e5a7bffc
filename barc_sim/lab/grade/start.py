"""Starts a submission's process, with its pipes, its limits and the files that it may read."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import sysconfig
from functools import cache
from pathlib import Path
from typing import NamedTuple

from barc_sim.lab.grade import confinement, seccomp
from barc_sim.lab.grade.channel import Channel

_PACKAGES = Path(__file__).parents[3]
_SCRIPT = Path(__file__).with_name('child.py')
# The hash seed is fixed, so that sets have the same order each time; `python -I` would ignore it.
# BLAS would start threads, which are refused.
_ENVIRONMENT = {
    'PYTHONHASHSEED': '0',
    'PYTHONUTF8': '1',
    'OPENBLAS_NUM_THREADS': '1',
    'OMP_NUM_THREADS': '1',
}
_OTHER_PACKAGES = {'site-packages', 'dist-packages'}

#: Whether a process can be confined: by the kernel of Linux alone.
ON_LINUX = sys.platform == 'linux'


class Limits(NamedTuple):
    """Limits of a submission's process, far above the needs of slow code."""

    memory: int = 1 << 30  #: bytes of address space; NumPy takes a fifth of it
    cpu: int = 30  #: [s] of processor time, over all calls
    start: float = 60.0  #: [s] until it is confined; the submission does not run before
    call: float = 5.0  #: [s] of processor time for one request, which can have thousands of calls
    wait: float = 20.0  #: [s] for one request, on a busy machine or with a sleep
    total: float = 120.0  #: [s] for all requests of a submission, waits included
    output: int = 16_384  #: bytes kept of its output


class Unconfined(OSError):  # noqa: N818
    """The process could not be confined; the submission has not run."""


def start(
    folder: Path, limits: Limits, *, sandbox: bool
) -> tuple[subprocess.Popen[bytes], Channel]:
    """Start `child.py` in `folder`, and return it with the pipes to it.

    Raises
    ------
    Unconfined
        if `sandbox` is True and the kernel has no Landlock.
    """
    requests, our_requests = os.pipe()
    our_replies, replies = os.pipe()
    our_output, output = os.pipe()
    channel = Channel(our_requests, our_replies, our_output, keep=limits.output)
    passed = [requests, replies]
    ruleset, program = None, b''
    try:
        if sandbox:
            ruleset, program = _confinement(folder)
            passed.append(ruleset)
        arguments = {
            'requests': requests,
            'replies': replies,
            'ruleset': ruleset,
            'program': program.hex(),
            'parent': os.getpid(),
            'packages': str(_PACKAGES),
            'numpy': str(_numpy_folder()),
            'memory': limits.memory,
            'cpu': limits.cpu,
        }
        process = subprocess.Popen(  # noqa: S603 (our own script)
            [sys.executable, '-s', '-S', '-B', '-u', str(_SCRIPT), json.dumps(arguments)],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            pass_fds=passed,
            cwd=folder,
            env=_ENVIRONMENT,
            start_new_session=True,
        )
    except BaseException:
        channel.close()
        raise
    finally:
        for descriptor in (*passed, output):
            os.close(descriptor)
    return process, channel


def _confinement(folder: Path) -> tuple[int, bytes]:
    """Return the descriptor of a Landlock ruleset for code in `folder`, and a seccomp program."""
    readable, listable = _python()
    try:
        program = seccomp.program()
        ruleset = confinement.create_ruleset((folder, *readable), listable, (Path(os.devnull),))
    except OSError as error:
        raise Unconfined(error.strerror or str(error)) from None
    return ruleset, program


@cache
def _python() -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """Return what Python and NumPy read, and the folders that they list.

    Nothing is of other packages, such as barc_sim itself. The folder of the standard library can
    contain other packages, so its parts are named one by one; imports list it.
    """
    library = Path(os.__file__).parent
    parts = [path for path in library.iterdir() if path.name not in _OTHER_PACKAGES]
    extensions = Path(str(sysconfig.get_config_var('DESTSHARED') or library / 'lib-dynload'))
    numpy = _numpy_folder()
    # Beside it, where NumPy came as a wheel, the libraries that it needs.
    libraries = (numpy.with_name('numpy.libs'), *_shared_libraries())
    return (*parts, extensions, numpy, *libraries), (library,)


def _numpy_folder() -> Path:
    spec = importlib.util.find_spec('numpy')
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError('NumPy is not installed')
    return Path(spec.origin).resolve().parent


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
