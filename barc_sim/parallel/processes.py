"""Worker processes of this machine, which survive the end of one of them."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import tempfile
import threading
from collections import deque
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import connection
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

from barc_sim.cli.python import working_in

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_MOST_ENDS = 3  #: of worker processes during one call, after which it is not made again


@dataclass(eq=False)
class _Call:
    """A call that was submitted, and the future that the caller has of it."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    future: Future[Any] = field(default_factory=Future)
    ends: int = 0  #: how often a process has ended while it was made or waited


class LocalProcesses(Executor):
    """Worker processes of this machine; the calls of one that ends are made again by another.

    When a process ends, for example because the system has killed it, its pool ends, with all calls
    that wait. These are made again in a new pool, one after the other, so that a call that ends its
    process takes no other with it: its exception is BrokenExecutor after the third time.

    One thread hands calls to the pool, and takes their results: a pool that ends holds a lock while
    it calls back, and whoever used it then would wait for ever.

    Parameters
    ----------
    jobs
        Number of processes; by default one for each core.
    begin
        Called in each process with `arguments` when it begins.
    arguments
        For `begin`.
    """

    def __init__(
        self, jobs: int | None, begin: Callable[..., None], arguments: tuple[Any, ...] = ()
    ) -> None:
        self._max_workers = jobs or os.cpu_count() or 1  # `pieces.workers_of` reads it
        self._begin = begin
        self._arguments = arguments

        # Only the thread uses these.
        self._pool = self._new_pool()
        self._unfinished: set[_Call] = set()
        self._again: deque[_Call] = deque()  # to be made again; the first one is being made
        self._has_ended = False

        self._actions: SimpleQueue[Callable[[], None]] = SimpleQueue()  # of the thread
        self._thread = threading.Thread(target=self._run, name='local processes', daemon=True)
        self._thread.start()

    def _new_pool(self) -> ProcessPoolExecutor:
        # New processes: a fork would copy the locks of other threads, but not the threads.
        context = multiprocessing.get_context('spawn')
        return ProcessPoolExecutor(self._max_workers, context, self._begin, self._arguments)

    def submit(  # type: ignore[override]  # mypy: of a ParamSpec
        self,
        function: Callable[..., Any],
        /,
        *arguments: Any,  # noqa: ANN401
    ) -> Future[Any]:
        """Have a process call `function`; return the future of its result."""
        if self._has_ended:
            raise RuntimeError('these processes have ended')
        call = _Call(function, arguments)
        self._actions.put(lambda: self._take(call))
        return call.future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes, as `ProcessPoolExecutor.shutdown` does; no call is made again."""
        if self._has_ended:
            return
        has_ended = threading.Event()
        self._actions.put(lambda: self._end(has_ended, cancel_futures=cancel_futures))
        has_ended.wait()
        if wait:
            self._thread.join()

    def _run(self) -> None:
        """Do what is asked for, until all calls have finished after the end."""
        while self._unfinished or not self._has_ended:
            action = self._actions.get()
            action()

    def _take(self, call: _Call) -> None:
        """Make a call, after those that are to be made again."""
        self._unfinished.add(call)
        if self._has_ended:
            self._cancel(call)
        elif self._again:
            self._again.append(call)
        else:
            self._make(call)

    def _make(self, call: _Call) -> None:
        """Hand a call to the pool."""
        try:
            future = self._pool.submit(call.function, *call.arguments)
        except BrokenExecutor:
            self._pool = self._new_pool()
            future = self._pool.submit(call.function, *call.arguments)
        future.add_done_callback(
            lambda future: self._actions.put(lambda: self._on_done(call, future))
        )

    def _on_done(self, call: _Call, future: Future[Any]) -> None:
        """Pass the result of a call on, or make it again if its process has ended."""
        if future.cancelled():
            self._cancel(call)
            return

        error = future.exception()
        if isinstance(error, BrokenExecutor):
            call.ends += 1
            if call.ends < _MOST_ENDS and not self._has_ended:
                self._make_again(call)
                return
        if self._again and self._again[0] is call:
            self._again.popleft()
            if self._again:
                self._make(self._again[0])

        self._unfinished.discard(call)
        if not call.future.set_running_or_notify_cancel():
            return
        if error is None:
            call.future.set_result(future.result())
        else:
            call.future.set_exception(error)

    def _make_again(self, call: _Call) -> None:
        """Make a call again, after those that are to be made again already."""
        if self._again and self._again[0] is call:
            self._make(call)
            return
        self._again.append(call)
        if len(self._again) == 1:
            self._make(call)

    def _cancel(self, call: _Call) -> None:
        """Finish a call that is not made."""
        self._unfinished.discard(call)
        call.future.cancel()
        call.future.set_running_or_notify_cancel()

    def _end(self, has_ended: threading.Event, *, cancel_futures: bool) -> None:
        """End the pool; from now on no other begins."""
        self._has_ended = True
        while len(self._again) > 1:  # the first one is in the pool
            self._cancel(self._again.pop())
        self._pool.shutdown(wait=False, cancel_futures=cancel_futures)
        has_ended.set()


@contextmanager
def processes(jobs: int | None) -> Iterator[Executor]:
    """Use `jobs` worker processes, by default one for each core.

    At the end of the block, workers that still run end, and their folders are removed; they also
    end with this process, however it ends. Within the block this process works in an empty folder,
    as its workers do.
    """
    with (
        tempfile.TemporaryDirectory(prefix='barc_sim_', ignore_cleanup_errors=True) as folder,
        # They would import a submission's `socket.py` from the working directory.
        working_in(Path(folder)),
    ):
        executor = LocalProcesses(jobs, _begin_worker, (folder,))
        try:
            yield executor
        finally:
            executor.shutdown(wait=False, cancel_futures=True)
            workers = multiprocessing.active_children()
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
    """End this process, and its folders, when the process of `sentinel` has ended."""
    connection.wait([sentinel])
    shutil.rmtree(tempfile.gettempdir(), ignore_errors=True)
    os._exit(1)
