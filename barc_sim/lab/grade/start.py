"""Starts a submission's process, with its pipes, its limits and the files that it may read."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from barc_sim.lab.grade import landlock, readable, seccomp
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
    program = b''
    try:
        if sandbox:
            ruleset, program = _confinement(folder)
            passed.append(ruleset)
        return _run(folder, limits, passed, program, output), channel
    except BaseException:
        channel.close()
        raise
    finally:
        for descriptor in (*passed, output):
            os.close(descriptor)


def _confinement(folder: Path) -> tuple[int, bytes]:
    """Return the descriptor of a Landlock ruleset for code in `folder`, and a seccomp program."""
    python = readable.python()
    try:
        program = seccomp.program()
        ruleset = landlock.create_ruleset(
            (folder, *python.readable), python.listable, python.writable
        )
    except OSError as error:
        raise Unconfined(error.strerror or str(error)) from None
    return ruleset, program


def _run(
    folder: Path, limits: Limits, passed: list[int], program: bytes, output: int
) -> subprocess.Popen[bytes]:
    """Start `child.py` with the descriptors of requests, replies and, if confined, the ruleset."""
    requests, replies, ruleset = (*passed, -1)[:3]
    return subprocess.Popen(  # noqa: S603 (our own script)
        [
            *(sys.executable, '-s', '-S', '-B', '-u', str(_SCRIPT)),
            *map(str, (requests, replies, ruleset, program.hex(), os.getpid(), _PACKAGES)),
            *map(str, (readable.numpy_folder(), limits.memory, limits.cpu)),
        ],
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=output,
        pass_fds=passed,
        cwd=folder,
        env=_ENVIRONMENT,
        start_new_session=True,
    )
