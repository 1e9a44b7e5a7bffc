"""Leadership: which thread polls, takes arrivals and begins callbacks."""

from __future__ import annotations

import os
import time
from contextlib import suppress

from barc_sim.ros.executor.linux import TIMER_ABSTIME, retire_timer, set_timer, timer, timespec

#: [s] after which a callback counts as lasting: another thread polls meanwhile.
LASTING = 1e-3
#: Minimum [s] between two settings of the timer, after a pause and while busy: a virtual machine
#: takes 20 us for one.
_PUT_OFF = 0.5e-3
_PUT_OFF_BUSY = 2e-3


class Leadership:
    """The right to poll, to take arrivals and to begin callbacks; one thread has it.

    The leader lends it while it calls a callback, and takes it back afterwards. When the call
    lasts, the thread that stands by takes it meanwhile. A timer wakes this thread, and is put off
    while calls are short. The atomic `pop` and `remove` of a list decide which thread gets it,
    without a lock or a system call.

    ======  ====================================================  ======
    state   event                                                 next
    ======  ====================================================  ======
    free    `take`, by any thread that may lead                   led
    led     `lend`, before a callback                             lent
    led     `release`: nothing is left to do, or an exception     free
    lent    `take_back`, after the callback, by the same thread   led
    lent    `take_over`, by the thread that stands by             led
    ======  ====================================================  ======
    """

    def __init__(self) -> None:
        self.free = [0.0]  #: when it was lent [s], 0 if it is free; empty while a thread leads
        self._lent = 0.0  # [s] when it was lent
        self._put_off = 0.0  # [s] when the timer may be set again
        self._timer = timer()

    def take(self) -> bool:
        """Lead from now on; return False if another thread leads."""
        with suppress(IndexError):
            self.free.pop()
            return True
        return False

    def lend(self, *, is_lasting: bool) -> float:
        """Let others take it during a call, at once if that is lasting; return the time [s]."""
        now = time.monotonic()
        self._lent = now - LASTING if is_lasting else now
        self.free.append(now)
        if is_lasting:
            self.wake_stand_by()
        elif now >= self._put_off:
            is_busy = now - self._put_off < _PUT_OFF
            put_off = _PUT_OFF_BUSY if is_busy else _PUT_OFF
            self.wake_stand_by(LASTING + put_off, put_off)
        return now

    def take_back(self, lent: float) -> bool:
        """Take it back after `lend`, which returned `lent`; False: another thread has led since."""
        with suppress(ValueError):
            self.free.remove(lent)
            return True
        return False

    def release(self, seconds: float = 0.0) -> None:
        """Give it to the thread that stands by, which wakes up in `seconds` to take it."""
        self._lent = 0.0
        self.free.append(0.0)
        self.wake_stand_by(seconds)

    def take_over(self) -> bool:
        """Take it from a callback that lasts; otherwise wait until another try makes sense."""
        if self.free:
            left = self._lent + LASTING - time.monotonic()
            if left <= 0:
                return self.take()
            self.wake_stand_by(left)
        self.stand_by()
        return False

    def stand_by(self) -> None:
        """Wait until `wake_stand_by` has woken this thread."""
        os.read(self._timer, 8)

    def wake_stand_by(self, seconds: float = 0.0, put_off: float = 0.0) -> None:
        """End the wait of the thread that stands by in `seconds`.

        A `lend` in the next `put_off` seconds need not set the timer, which expires later.
        """
        now = time.monotonic()
        due = bytes(16) + timespec(now + seconds)
        # No other thread runs between these two lines: neither calls a function of Python.
        self._put_off = now + put_off
        set_timer(self._timer, TIMER_ABSTIME, due, None)

    def close(self) -> None:
        """Give it up for good, once no thread stands by."""
        self.release()
        retire_timer(self._timer)
