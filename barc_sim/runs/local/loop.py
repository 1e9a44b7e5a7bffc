"""The loop of a run without ROS: callbacks, timers, and calls of other threads."""

from __future__ import annotations

import time
from collections import deque
from math import inf
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


class Timer:
    """Calls back every `period` [s], from `reset` to `cancel`.

    Examples
    --------
    >>> timer = Timer(0.02, lambda: print('due'))
    >>> timer.due = 10.0
    >>> timer.fire(now=10.05)
    due
    >>> round(timer.due, 2)
    10.06
    """

    def __init__(self, period: float, callback: Callable[[], object]) -> None:
        """Begin cancelled."""
        self.period = period
        self.callback = callback
        self.due = inf  #: [s] by the monotonic clock

    def reset(self) -> None:
        """Call back one period from now, and so on."""
        self.due = time.monotonic() + self.period

    def cancel(self) -> None:
        """Stop calling back."""
        self.due = inf

    def fire(self, now: float) -> None:
        """Call back; periods that have passed entirely are left out."""
        self.due += self.period * (1 + int((now - self.due) / self.period))
        self.callback()


class Loop:
    """Runs callbacks one after the other in the thread of `run`.

    Examples
    --------
    >>> loop, done = Loop(), []
    >>> loop.soon(lambda: done.append('soon'))
    >>> loop.call(lambda: done.append('call'))
    >>> loop.timer(0.01, lambda: done.append('timer')).reset()
    >>> loop.run(lambda: 'timer' in done)
    >>> done
    ['soon', 'call', 'timer']
    """

    def __init__(self) -> None:
        """Begin without callbacks."""
        self._ready: deque[Callable[[], object]] = deque()
        self._calls: SimpleQueue[Callable[[], object]] = SimpleQueue()
        self._timers: list[Timer] = []

    def soon(self, callback: Callable[[], object]) -> None:
        """Run `callback` after the present one; call it in the loop's thread only."""
        self._ready.append(callback)

    def call(self, callback: Callable[[], object]) -> None:
        """Run `callback` in the loop's thread; may be called from any thread."""
        self._calls.put(callback)

    def timer(self, period: float, callback: Callable[[], object]) -> Timer:
        """Return a timer, which is not running yet."""
        self._timers.append(Timer(period, callback))
        return self._timers[-1]

    def run(self, finished: Callable[[], bool]) -> None:
        """Run until `finished` returns True; it is asked after each callback."""
        ready, calls = self._ready, self._calls
        while not finished():
            if ready:
                ready.popleft()()
                if calls.empty():
                    # Timers wait for no more than one period: a lock-step run has none due.
                    continue
            self._wait()

    def _wait(self) -> None:
        """Run the calls of other threads and the timers that are due; wait for one of them."""
        timer = min(self._timers, key=lambda each: each.due, default=None)
        due = timer.due if timer else inf
        wait = 0.0 if self._ready else due - time.monotonic()
        try:
            if wait <= 0.0:
                self._calls.get_nowait()()
            else:
                self._calls.get(timeout=None if wait == inf else wait)()
        except Empty:
            pass
        now = time.monotonic()
        if timer and now >= timer.due:
            timer.fire(now)
