"""Starts a submission's process, with its pipes, its limits and what it may read."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from barc_sim.lab.grade import landlock, readable
from barc_sim.lab.grade.channel import Channel

_PACKAGES = Path(__file__).parents[3]
_SCRIPT = Path(__file__).with_name('child.py')
# The seed of hashes is fixed so that sets are in the same order each time; `python -I` would take
# no notice of it. BLAS would start threads, which are refused.
_ENVIRONMENT = {
    'PYTHONHASHSEED': '0',
    'PYTHONUTF8': '1',
    'OPENBLAS_NUM_THREADS': '1',
    'OMP_NUM_THREADS': '1',
}


class Limits(NamedTuple):
    """What a submission's process may use up; none of it tells good code from slow code."""

    memory: int = 1 << 30  #: bytes of address space; NumPy takes a fifth of it
    cpu: int = 30  #: [s] of processor time, over all calls
    start: float = 60.0  #: [s] until it is confined; nothing of the submission runs before
    call: float = 5.0  #: [s] of processor time for one request, of up to thousands of calls
    wait: float = 20.0  #: [s] for it on a busy machine, or to one who sleeps
    output: int = 16_384  #: bytes of what it prints are kept


class Unconfined(OSError):  # noqa: N818
    """The process could not be confined; nothing of the submission has been run."""


def start(
    folder: Path, limits: Limits, *, sandbox: bool
) -> tuple[subprocess.Popen[bytes], Channel]:
    """Start `child.py` in `folder`, and return it with the pipes to it.

    Raises
    ------
    Unconfined
        where the kernel has no Landlock, but for `sandbox` False.
    """
    requests, our_requests = os.pipe()
    our_replies, replies = os.pipe()
    our_output, output = os.pipe()
    channel = Channel(our_requests, our_replies, our_output, keep=limits.output)
    passed = [requests, replies]
    try:
        if sandbox:
            passed.append(_ruleset(folder))
        return _run(folder, limits, passed, output), channel
    except BaseException:
        channel.close()
        raise
    finally:
        for descriptor in (*passed, output):
            os.close(descriptor)


def _ruleset(folder: Path) -> int:
    """Return the descriptor of a Landlock ruleset for code in `folder`."""
    python = readable.python()
    try:
        return landlock.create_ruleset((folder, *python.readable), python.listable, python.writable)
    except OSError as error:
        raise Unconfined(error.strerror) from None


def _run(folder: Path, limits: Limits, passed: list[int], output: int) -> subprocess.Popen[bytes]:
    """Start `child.py` with the descriptors of requests, replies and, where it is, ruleset."""
    requests, replies, ruleset = (*passed, -1)[:3]
    return subprocess.Popen(  # noqa: S603 (our own script)
        [
            *(sys.executable, '-s', '-S', '-B', '-u', str(_SCRIPT)),
            *map(str, (requests, replies, ruleset, os.getpid(), _PACKAGES)),
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
