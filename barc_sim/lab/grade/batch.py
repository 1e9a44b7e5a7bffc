"""Grades many submissions at once, on this machine's cores or on a Dask cluster."""

from __future__ import annotations

import multiprocessing
import signal
from concurrent.futures import FIRST_COMPLETED, Executor, ProcessPoolExecutor, wait
from contextlib import contextmanager
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.cli.dask_cluster import client
from barc_sim.lab.grade.report import report
from barc_sim.lab.grade.submissions import read

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from concurrent.futures import Future
    from pathlib import Path

    from barc_sim.lab.grade.report import Report
    from barc_sim.lab.grade.rubric import Rubric
    from barc_sim.lab.grade.start import Limits


class Failure(NamedTuple):
    """A submission that could not be graded, because of an error of the grader."""

    reason: str


@contextmanager
def local(jobs: int) -> Iterator[Executor]:
    """Give `jobs` processes of this machine; after Ctrl-C they finish their current submission."""
    # New processes: a fork would copy the locks of other threads, but not the threads.
    context = multiprocessing.get_context('spawn')
    with ProcessPoolExecutor(jobs, context, initializer=_ignore_interrupt) as pool:
        yield pool


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
                yield pending.pop(future), _outcome(future)

    try:
        yield outcomes()
    finally:
        for future in pending:
            future.cancel()


def _outcome(future: Future[Report]) -> Report | Failure:
    error = future.exception()
    if error is None:
        return future.result()
    return Failure(f'{type(error).__name__}: {error}')


def _ignore_interrupt() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
