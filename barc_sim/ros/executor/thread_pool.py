"""The threads that execute callbacks beside the spinning one."""

from __future__ import annotations

from collections import deque
from threading import Condition, get_ident
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from concurrent.futures import ThreadPoolExecutor


class ThreadPool:
    """Calls each function that is submitted once, and keeps what it raises.

    Parameters
    ----------
    threads
        Those that call.
    ended
        Called in the thread whenever a function has returned or raised.
    """

    def __init__(self, threads: ThreadPoolExecutor, ended: Callable[[], None]) -> None:
        self.failures: deque[BaseException] = deque()  #: for the spinning thread to raise
        self._threads = threads
        self._ended = ended
        self._inside: set[int] = set()  # threads that call a function
        self._unfinished = 0
        self._changed = Condition()
        self._closed = False

    def submit(self, function: Callable[[], object], drop: Callable[[], object]) -> None:
        """Call a function in a thread of the pool, or `drop` where the pool is closed by then."""
        with self._changed:
            if not self._closed:
                self._unfinished += 1
                self._threads.submit(self._run, function, drop)
                return
        drop()

    def _run(self, function: Callable[[], object], drop: Callable[[], object]) -> None:
        self._inside.add(get_ident())
        try:
            drop() if self._closed else function()
        except BaseException as error:  # noqa: BLE001 - the spinning thread raises it
            self.failures.append(error)
        finally:
            self._inside.discard(get_ident())
            with self._changed:
                self._unfinished -= 1
                self._changed.notify_all()
            self._ended()

    def is_inside(self) -> bool:
        """Whether this thread calls a function of the pool."""
        return get_ident() in self._inside

    def close(self, timeout_sec: float) -> bool:
        """Begin no further function; return whether all end within a time (-1: no limit)."""
        with self._changed:
            self._closed = True
            return self._changed.wait_for(
                lambda: not self._unfinished, None if timeout_sec < 0 else timeout_sec
            )
