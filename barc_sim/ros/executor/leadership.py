"""Which thread polls: the leader does, and another one takes over when a callback lasts."""

from __future__ import annotations

import os
import time

from barc_sim.ros.executor.descriptors import set_time, timerfd

#: [s] A callback that takes longer lasts: another thread polls meanwhile.
LASTING = 1e-3
_PUT_OFF = 0.5e-3  # s; the timer is set so often at most
_LONG = 5e-3  # s
_spare_timers: list[int] = []


class Leadership:
    """The right to poll, to take what has arrived and to begin callbacks; one thread has it.

    The leader lends it for as long as it calls a callback, and takes it back after. When the call
    lasts, the thread that stands by takes it first. `list.pop` decides who gets it, so that the
    leader needs no lock, no system call and no other thread for a short callback. A timer wakes
    the thread that stands by; the leader puts it off while its callbacks are short, and nothing
    wakes while it waits.
    """

    def __init__(self) -> None:
        self._free = [0.0]  # when it was lent [s], unless a thread has it
        self._lent = 0.0  # [s] when it was lent
        self._timer = _spare_timers.pop() if _spare_timers else timerfd()
        self._put_off = 0.0  # [s] when the timer may be set again

    def take(self) -> bool:
        """Lead from now on; return False where another thread polls."""
        try:
            self._free.pop()
        except IndexError:
            return False
        return True

    def lend(self, lasting: bool) -> float:
        """Let others take it while this thread calls a callback; return the time [s].

        If the callback is expected to be `lasting`, the thread that stands by takes it at once.
        """
        now = time.monotonic()
        self._lent = now - LASTING if lasting else now
        self._free.append(now)
        if lasting or now >= self._put_off:
            self.wake_stand_by(0.0 if lasting else LASTING + _PUT_OFF)
        return now

    def take_back(self, lent: float) -> bool:
        """Take back what `lend` has lent; return False where another thread has led since."""
        try:
            free = self._free.pop()
        except IndexError:
            return False
        if free is not lent:
            self._free.append(free)
        return free is lent

    def release(self, seconds: float = 0.0) -> None:
        """Have the thread that stands by wake up, so many seconds from now, and take it."""
        self._lent = 0.0
        self._free.append(0.0)
        self.wake_stand_by(seconds)

    @property
    def is_free(self) -> bool:
        """Whether no thread polls."""
        return bool(self._free)

    def take_over(self, *, wanted: bool) -> bool:
        """Take it from a callback that lasts, or else wait until this is worth another try."""
        if wanted and self._free:
            left = self._lent + LASTING - time.monotonic()
            if left <= 0:
                return self.take()
            self.wake_stand_by(left)
        os.read(self._timer, 8)
        return False

    def wake_stand_by(self, seconds: float = 0.0) -> None:
        """End the wait of the thread that stands by, so many seconds from now."""
        now = time.monotonic()
        # A `lend` before `_put_off` need not set the timer, as it expires soon after that.
        self._put_off = now + min(seconds, _PUT_OFF) if seconds < _LONG else now
        set_time(self._timer, now + seconds)

    def close(self) -> None:
        """Give it back for good, once no thread stands by."""
        self.release()
        _spare_timers.append(self._timer)  # not closed, as a thread may still set it
