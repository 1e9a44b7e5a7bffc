"""The processes that share a search's loops: on this machine, or of a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.cli.dask_cluster import client as cluster_client
from barc_sim.errors import UserError
from barc_sim.tuning.goal import Goal

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Costs = Callable[[Floats], Floats]

#: Parts for each worker, so that none waits long for the slowest.
_PARTS = 3
#: Loops of a part where NumPy drives them all at once: fewer take hardly less time.
_BATCH = 2048


def cores() -> int:
    """Return the number of cores that this process may use, where the system limits that."""
    if hasattr(os, 'sched_getaffinity'):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def processes(cost: Costs) -> Iterator[Costs]:
    """Share the loops of `cost` among processes, one for each core of this machine.

    The processes ignore Ctrl-C: the process that started them ends them.
    """
    workers = cores()
    pool = ProcessPoolExecutor(
        workers,
        # Not forked: a copy of a process with threads may hold their locks for ever.
        multiprocessing.get_context('spawn'),
        initializer=signal.signal,
        initargs=(signal.SIGINT, signal.SIG_IGN),
    )

    def shared(gains: Floats) -> Floats:
        with _interrupts_blocked():
            futures = [pool.submit(cost, part) for part in _parts(gains, workers)]
        try:
            return np.concatenate([future.result() for future in futures])
        except BrokenProcessPool:
            raise UserError(
                'a process that drove the controller has died: does it end its process, or use '
                'more memory than there is?'
            ) from None

    try:
        yield shared
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C, where processes that start meanwhile inherit that.

    Until it ignores the signal itself, a process would end with a traceback.
    """
    if not hasattr(signal, 'pthread_sigmask'):
        yield
        return
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])


@contextmanager
def cluster(cost: Costs, address: str) -> Iterator[Costs]:
    """Share the loops of `cost` among the workers of the Dask scheduler at `address`.

    Loops that NumPy drives all at once are divided into large parts only, as a part of 40 loops
    takes as long as one of 250. A single part is driven here: its way to a worker and back would
    only add to it.
    """
    batched = isinstance(cost, Goal) and not cost.new_controller
    with cluster_client(address) as client:
        workers = sum(client.ncores().values())

        def shared(gains: Floats) -> Floats:
            parts = _parts(gains, workers, _BATCH if batched else 1)
            if len(parts) == 1:
                return cost(gains)
            try:
                futures = client.map(cost, parts, key='cost', pure=False)
                return np.concatenate(client.gather(futures))
            except UserError:
                raise
            except Exception as error:
                raise UserError(
                    f'the Dask cluster at {address!r} failed: {type(error).__name__}: {error}; '
                    'its workers need this version of barc_sim, and the files at the same paths'
                ) from error

        yield shared


def _parts(gains: Floats, workers: int, minimum: int = 1) -> list[Floats]:
    """Divide gains, shape `(n, 3)`, into parts of about `minimum` or more."""
    return np.array_split(gains, max(1, min(len(gains) // minimum, _PARTS * workers)))
