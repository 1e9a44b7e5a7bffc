"""Hands out work in pieces to an executor, and takes the results as they are ready."""

from __future__ import annotations

import os
import time
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, wait
from itertools import islice
from pickle import PicklingError
from typing import TYPE_CHECKING, Any, TypeVar

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from concurrent.futures import Future

Piece = TypeVar('Piece')
Result = TypeVar('Result')

#: Pieces of each worker that are handed out at a time: one to work at, the others on their way.
_PENDING = 3
_COUNT_PERIOD = 1.0  #: [s] after which the workers are counted again: some can have joined
#: What the exceptions of pickle say, in different versions of Python.
_UNSENDABLE = ('pickle', "Can't get local object")
_PIECE_DURATION = 1.0  #: [s] that a piece should take
_GROWTH = 16  #: times the size of the pieces before
#: Number of pieces of each worker at least, so that all end at about the same time.
_PIECES = 4


def finished_pieces(
    executor: Executor,
    function: Callable[[Piece], Result],
    pieces: Iterable[Piece],
    stopped: Future[Any] | None = None,
    *,
    ordered: bool = False,
) -> Iterator[tuple[Piece, Future[Result]]]:
    """Yield each piece with the future of its call of `function`, when that has finished.

    The pieces are taken as workers become free. When the iterator is closed, calls that have not
    begun are cancelled.

    Parameters
    ----------
    executor
        Makes the calls; any of `concurrent.futures`, or a class derived from it, such as that of
        Dask's `Client.get_executor()`.
    function
        The work; it must be importable by the workers.
    pieces
        Its arguments.
    stopped
        When this is done, the iterator ends.
    ordered
        Whether to yield the pieces in their order.

    Raises
    ------
    UserError
        `executor` is no executor.
    """
    if not isinstance(executor, Executor):
        raise UserError(
            f'executor={executor!r} is no Executor of concurrent.futures: give one; of a Client '
            'of Dask it is client.get_executor()'
        )

    pieces_left = iter(pieces)
    limit = 0
    count_due = time.monotonic()
    stops = set() if stopped is None else {stopped}
    pending: dict[Future[Any], Piece] = {}
    try:
        while not any(stop.done() for stop in stops):
            if time.monotonic() >= count_due:
                limit = _PENDING * workers_of(executor)
                count_due = time.monotonic() + _COUNT_PERIOD

            # Fewer than are pending when workers have left.
            for piece in islice(pieces_left, max(limit - len(pending), 0)):
                pending[executor.submit(function, piece)] = piece
            if not pending:
                return

            candidates = [next(iter(pending))] if ordered else [*pending]
            done, _ = wait([*stops, *candidates], return_when=FIRST_COMPLETED)
            for future in done - stops:
                yield pending.pop(future), future
    finally:
        for future in pending:
            future.cancel()


def result_of(future: Future[Result]) -> Result:
    """Return the result of a call; its exception, or UserError: its worker ended."""
    try:
        return future.result()
    except BrokenExecutor as error:
        raise UserError(
            f'a worker process ended ({error}): give an executor that repeats its work, such as '
            "Dask's Client.get_executor()"
        ) from None
    except (PicklingError, AttributeError, TypeError) as error:
        if not any(words in str(error) for words in _UNSENDABLE):
            raise
        raise UserError(
            f'the work cannot be sent to another process ({error}): define its functions and '
            'classes in a module, not inside a function'
        ) from None


def workers_of(executor: Executor) -> int:
    """Return the number of calls that an executor makes at a time, as far as it is known."""
    client = getattr(executor, '_client', None)  # of Dask
    if client is not None:
        threads: int = sum(client.nthreads().values())
        return max(threads, 1)
    return int(getattr(executor, '_max_workers', None) or os.cpu_count() or 1)


class PieceSizes:
    """Chooses how many runs make a piece of about a second, from the fastest piece so far.

    A worker's first piece is slow, as it imports and compiles.

    Parameters
    ----------
    runs
        The number of runs in all pieces.
    workers
        The number of workers.
    """

    def __init__(self, runs: int, workers: int) -> None:
        self._runs = runs
        self._largest = max(runs // (_PIECES * workers), 1)
        self._size = 1

    def ranges(self) -> Iterator[range]:
        """Yield the numbers of each piece's runs; each range has the size of the moment."""
        first = 0
        while first < self._runs:
            runs = range(first, min(first + self._size, self._runs))
            yield runs
            first = runs.stop

    def measured(self, runs: range, duration: float) -> None:
        """Take the duration [s] of a piece for the sizes of the next ones."""
        per_second = len(runs) / max(duration, 1e-9)
        longest = min(_GROWTH * len(runs), self._largest)
        size = min(round(_PIECE_DURATION * per_second), longest)
        self._size = max(self._size, size)
