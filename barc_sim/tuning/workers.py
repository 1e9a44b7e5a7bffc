"""The processes that share a search's work: this machine's, or a Dask cluster's."""

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

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Costs = Callable[[Floats], Floats]

#: Parts for each worker, so that none waits long for the slowest.
_PARTS = 3


@contextmanager
def processes(cost: Costs) -> Iterator[Costs]:
    """Give `cost` as this machine's cores work it out together, each in a process of its own.

    The processes take no notice of Ctrl-C: whoever started them ends them.
    """
    cores = len(os.sched_getaffinity(0))
    # Not forked, which threads (Numba's, say) would not survive.
    pool = ProcessPoolExecutor(cores, multiprocessing.get_context('spawn'))

    def shared(gains: Floats) -> Floats:
        # Before the first of them has begun: it would end with a traceback.
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            futures = [pool.submit(cost, part) for part in _parts(gains, cores)]
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
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
def cluster(cost: Costs, address: str) -> Iterator[Costs]:
    """Give `cost` as the workers of the Dask scheduler at `address` work it out together.

    Raises
    ------
    UserError
        where Dask is not installed, or the cluster is not there or does not work.
    """
    with cluster_client(address) as client:
        cores = sum(client.ncores().values())

        def shared(gains: Floats) -> Floats:
            try:
                futures = client.map(cost, _parts(gains, cores), key='cost', pure=False)
                return np.concatenate(client.gather(futures))
            except UserError:
                raise
            except Exception as error:
                raise UserError(
                    f'the Dask cluster at {address!r} failed: {type(error).__name__}: {error}; '
                    'its workers need this version of barc_sim, and the files at the same paths'
                ) from error

        yield shared


def _parts(gains: Floats, workers: int) -> list[Floats]:
    return np.array_split(gains, min(len(gains), _PARTS * workers))
