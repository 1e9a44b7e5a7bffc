"""When something happened, how long the thread waited for a core before, and the work done."""

from __future__ import annotations

import os
import threading
import time
from typing import NamedTuple


class Tick(NamedTuple):
    """One moment, by several clocks."""

    time: float  #: [s] of `perf_counter`
    wait: float  #: [s] in which the kernel kept the thread waiting, since its tick before
    processor: float  #: [s] of processor time of the process
    counter: int  #: of the busy thread


class TickLog:
    """The ticks of a process, and a count that a busy thread can raise."""

    def __init__(self) -> None:
        self.ticks: list[Tick] = []
        self._counter = 0
        #: The thread that notes can change: each one keeps its own file and its own wait.
        self._thread = threading.local()

    def note(self) -> None:
        """Add a tick for this moment."""
        now = time.perf_counter()
        thread = self._thread
        if not hasattr(thread, 'file'):
            thread.file = os.open('/proc/thread-self/schedstat', os.O_RDONLY)
            thread.total_wait = 0.0

        total_wait = int(os.pread(thread.file, 100, 0).split()[1]) * 1e-9
        wait = total_wait - thread.total_wait
        thread.total_wait = total_wait
        self.ticks.append(Tick(now, wait, time.process_time(), self._counter))

    def count(self) -> None:
        """Count for ever, as a busy thread does."""
        while True:
            self._counter += 1
