"""Grades many submissions at once, on this machine's cores or on a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from concurrent.futures import FIRST_COMPLETED, Executor, ProcessPoolExecutor, wait
from contextlib import contextmanager
from functools import partial
from itertools import islice
from multiprocessing import connection
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.cli.dask_cluster import client
from barc_sim.lab.grade.grade import report
from barc_sim.lab.grade.submissions import read

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from concurrent.futures import Future
    from multiprocessing.process import BaseProcess
    from pathlib import Path

    from barc_sim.lab.confined.process import Limits
    from barc_sim.lab.grade.grade import Report
    from barc_sim.lab.grade.rubric import Rubric
    from barc_sim.lab.grade.submissions import Submission

_LAST_ACTS = 1.0  # [s] for a process to clean up before it ends


class Failure(NamedTuple):
    """A submission that could not be graded, because of an error of the grader."""

    reason: str


@contextmanager
def local(jobs: int) -> Iterator[Executor]:
    """Give `jobs` processes of this machine.

    When the block ends, those still at work clean up and end; they also end with this process,
    however it ends.
    """
    # New processes: a fork would copy the locks of other threads, but not the threads.
    context = multiprocessing.get_context('spawn')
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(jobs, context, initializer=_begin_worker)
    try:
        yield pool
    finally:
        # A second Ctrl-C would only delay the end.
        before = _ignore_interrupts()
        pool.shutdown(wait=False, cancel_futures=True)
        _end([p for p in multiprocessing.active_children() if p not in others])
        if before is not None:
            signal.signal(signal.SIGINT, before)


def _ignore_interrupts() -> Any:  # noqa: ANN401 (as signal.signal's)
    """Ignore Ctrl-C, where that can be done: in the main thread; return what was done before."""
    if threading.current_thread() is not threading.main_thread():
        return None
    return signal.signal(signal.SIGINT, signal.SIG_IGN)


def _end(processes: Sequence[BaseProcess]) -> None:
    """End the processes: idle ones by themselves, the others by a signal, then by force."""
    for patience, end in ((0.3, 'terminate'), (1.0, 'kill'), (1.0, '')):
        deadline = time.monotonic() + patience
        for process in processes:
            process.join(max(deadline - time.monotonic(), 0.0))
            if end and process.is_alive():
                getattr(process, end)()


@contextmanager
def dask(address: str) -> Iterator[Executor]:
    """Give the workers of the Dask cluster whose scheduler listens at `address`.

    Raises
    ------
    UserError
        if `distributed` is not installed, or no scheduler answers.
    """
    with client(address) as cluster, cluster.get_executor(pure=False) as executor:
        yield executor


@contextmanager
def run(
    executor: Executor,
    paths: Iterable[Path],
    rubric: Rubric,
    limits: Limits,
    *,
    at_once: int,
    sandbox: bool,
) -> Iterator[Iterator[tuple[Path, Report | Failure]]]:
    """Give each submission with its report, in the order of completion.

    At most `at_once` are in work, so that their files do not fill the memory. When the block ends,
    no further submission is started.
    """
    work = partial(_report, rubric=rubric, limits=limits, sandbox=sandbox)
    waiting = iter(paths)
    pending: dict[Future[Report], Path] = {}

    def outcomes() -> Iterator[tuple[Path, Report | Failure]]:
        while True:
            for path in islice(waiting, at_once - len(pending)):
                pending[executor.submit(work, read(path))] = path
            if not pending:
                return
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                error = future.exception()
                failure = Failure(f'{type(error).__name__}: {error}') if error else None
                yield pending.pop(future), failure or future.result()

    try:
        yield outcomes()
    finally:
        for future in pending:
            future.cancel()


class _Stopped(BaseException):
    """Ends a worker; what it is doing cleans up."""


def _begin_worker() -> None:
    """Leave Ctrl-C to the parent process, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        # Its end closes a pipe, also where it is killed.
        threading.Thread(target=_follow, args=(parent.sentinel,), daemon=True).start()


def _follow(sentinel: int) -> None:
    connection.wait([sentinel])
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_LAST_ACTS)
    os._exit(1)


def _report(submission: Submission, rubric: Rubric, limits: Limits, *, sandbox: bool) -> Report:
    """Return the report of a submission; a SIGTERM ends this process, and what it has started."""
    if multiprocessing.parent_process() is None or (
        threading.current_thread() is not threading.main_thread()
    ):
        return report(submission, rubric=rubric, limits=limits, sandbox=sandbox)

    def stop(*_: object) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        raise _Stopped

    before = signal.signal(signal.SIGTERM, stop)
    try:
        return report(submission, rubric=rubric, limits=limits, sandbox=sandbox)
    except _Stopped:
        os._exit(1)
    finally:
        signal.signal(signal.SIGTERM, before)
