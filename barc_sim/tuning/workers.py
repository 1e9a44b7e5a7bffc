"""The processes of this machine that share the loops of a search."""

from __future__ import annotations

import multiprocessing
import os
import signal
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Costs = Callable[[Floats], Floats]

#: Parts for each worker, so that none waits long for the slowest.
_PARTS = 3


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
            parts = np.array_split(gains, max(1, min(len(gains), _PARTS * workers)))
            futures = [pool.submit(cost, part) for part in parts]
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
