"""Grades many submissions at once, on this machine's cores or on a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
import tempfile
import threading
from concurrent.futures import FIRST_COMPLETED, Executor, ProcessPoolExecutor, wait
from contextlib import contextmanager, suppress
from functools import partial
from itertools import islice
from multiprocessing import connection
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.cli.dask_cluster import client
from barc_sim.cli.signals import uninterrupted
from barc_sim.lab.grade.grade import report
from barc_sim.lab.grade.submissions import read

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from concurrent.futures import Future
    from pathlib import Path

    from barc_sim.lab.confined.process import Limits
    from barc_sim.lab.grade.grade import Report
    from barc_sim.lab.grade.rubric import Rubric


class Failure(NamedTuple):
    """A submission that could not be graded, because of an error of the grader."""

    reason: str


@contextmanager
def local(jobs: int) -> Iterator[Executor]:
    """Give `jobs` processes of this machine.

    When the block ends, those still at work end, and their folders go; they also end with this
    process, however it ends.
    """
    # New processes: a fork would copy the locks of other threads, but not the threads.
    context = multiprocessing.get_context('spawn')
    others = set(multiprocessing.active_children())
    with tempfile.TemporaryDirectory(prefix='barc_sim_', ignore_cleanup_errors=True) as folder:
        pool = ProcessPoolExecutor(jobs, context, initializer=_begin_worker, initargs=(folder,))
        try:
            yield pool
        finally:
            # A second Ctrl-C would only delay the end.
            with suppress(KeyboardInterrupt), uninterrupted():
                pool.shutdown(wait=False, cancel_futures=True)
                workers = [each for each in multiprocessing.active_children() if each not in others]
                for worker in workers:
                    worker.kill()
                for worker in workers:
                    worker.join()


def _begin_worker(folder: str) -> None:
    """Make temporary folders in `folder`, leave Ctrl-C to the parent process, and end with it."""
    tempfile.tempdir = folder
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent  # noqa: S101 (the pool's)
    # Its end closes a pipe, also where it is killed.
    threading.Thread(target=_follow, args=(parent.sentinel,), daemon=True).start()


def _follow(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)


@contextmanager
def dask(address: str) -> Iterator[Executor]:
    """Give the workers of the Dask cluster whose scheduler listens at `address`."""
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
    work = partial(report, rubric=rubric, limits=limits, sandbox=sandbox)
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
