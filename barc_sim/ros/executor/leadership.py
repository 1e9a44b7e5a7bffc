"""Which thread polls: the leader does, and another one takes over when a callback lasts."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from threading import Event
from typing import TYPE_CHECKING

from barc_sim.ros.executor.descriptors import set_time, timerfd

if TYPE_CHECKING:
    from collections.abc import Callable

#: [s] A callback that takes longer lasts: another thread polls meanwhile.
LASTING = 1e-3
_PUT_OFF = 0.5e-3  # s; the timer is set so often at most


class Leadership:
    """The right to poll, to take what has arrived and to begin callbacks; one thread has it.

    The leader lends it for as long as it calls a callback, and takes it back after. When the call
    lasts, the thread that stands by takes it first. `list.pop` decides who gets it, so that the
    leader needs no lock, no system call and no other thread for a short callback. A timer wakes
    the thread that stands by; the leader puts it off while its callbacks are short, and nothing
    wakes while it waits.

    Parameters
    ----------
    wake
        Ends the wait of the thread that polls.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        """Lead nowhere: the first `take` succeeds."""
        self._wake = wake
        self._free = [0.0]  # when it was lent [s], unless a thread has it
        self._lent = 0.0  # [s] when it was lent
        self._claims: list[bool] = []
        self._released = Event()
        self._timer = timerfd(blocking=True)
        self._put_off = 0.0  # [s] when the timer may be set again
        self._closed = False

    def take(self) -> bool:
        """Lead from now on; return False where another thread polls."""
        try:
            self._free.pop()
        except IndexError:
            return False
        return True

    def lend(self, *, lasting: bool = False) -> float:
        """Let others take it while this thread calls a callback; return what `take_back` is given.

        That is the time [s]. If the callback is expected to be `lasting`, the thread that stands by
        takes it at once.
        """
        now = time.monotonic()
        self._lent = now - LASTING if lasting else now
        self._free.append(now)
        if lasting or now >= self._put_off:
            self._set_timer(now, 0.0 if lasting else LASTING + _PUT_OFF)
        if self._claims:
            self._released.set()
        return now

    def take_back(self, lent: float) -> bool:
        """Take back what `lend` has lent; return False where another thread has led since."""
        try:
            free = self._free.pop()
        except IndexError:
            return False
        if free is lent:
            return True
        self.release()
        return False

    def release(self) -> None:
        """Have the thread that stands by take it."""
        self._lent = 0.0
        self._free.append(0.0)
        self._released.set()
        self.wake_stand_by()

    def claim(self, seconds: float) -> bool:
        """Take it from whichever thread polls; return False where that takes longer."""
        deadline = time.monotonic() + seconds
        self._claims.append(True)
        try:
            while not self.take():
                self._released.clear()
                self._wake()
                if self.take():
                    break
                left = deadline - time.monotonic()
                if left <= 0:
                    return False
                self._released.wait(min(left, 0.05))
        finally:
            self._claims.pop()
        return True

    @property
    def claimed(self) -> bool:
        """Whether the leader is to give it back before it polls again."""
        return bool(self._claims)

    def take_over(self) -> bool:
        """Take it from a callback that lasts, or else have `wait` return when this one would."""
        if not self._free:
            return False
        now = time.monotonic()
        left = self._lent + LASTING - now
        if left > 0:
            self._set_timer(now, left)
            return False
        return self.take()

    def wait(self) -> None:
        """Wait until `take_over` is worth another try."""
        with suppress(OSError):  # closed
            os.read(self._timer, 8)

    def wake_stand_by(self) -> None:
        """End the wait of the thread that stands by."""
        self._set_timer(time.monotonic(), 0.0)

    def _set_timer(self, now: float, seconds: float) -> None:
        # Whoever lends it before `_put_off` need not set the timer, as it expires after that.
        self._put_off = now + min(seconds, _PUT_OFF)
        if not self._closed:
            set_time(self._timer, (now + seconds) * 1e9)

    def close(self) -> None:
        """Close the timer, once no thread stands by."""
        if not self._closed:
            self._closed = True
            os.close(self._timer)
