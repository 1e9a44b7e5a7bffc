"""How threads wait: for Linux's descriptors, and for the right to poll them.

`select.epoll` gives up the interpreter's lock at each call. A busy executor then has it back before
another thread wakes up, which starves. Here the lock is given up only to wait; what is there at
once is found and read with the lock held.
"""

from __future__ import annotations

import ctypes
import os
import platform
import select
import time
from contextlib import suppress
from functools import partial
from struct import pack

_MOST = 64  # descriptors in one poll
#: The length of a struct epoll_event, and the place of the descriptor in it, both in integers of
#: four bytes: only x86-64 packs it without gaps. The number of the call sched_setattr.
_LENGTH, _PLACE, _SCHED_SETATTR = (3, 1, 314) if platform.machine() == 'x86_64' else (4, 2, 274)
_MONOTONIC, _ABSOLUTE = 1, 1  # CLOCK_MONOTONIC, TFD_TIMER_ABSTIME

#: [s] After a wait shorter than the second, the next one looks again for the first before it
#: sleeps: a halted core takes 50 us to wake up, more than another process needs for its answer.
_LOOK, _SHORT = 40e-6, 0.25e-3
#: [s] A callback that takes longer lasts: another thread polls meanwhile.
LASTING = 1e-3
#: [s] The timer is set so seldom, after a pause and while busy: it takes a virtual machine 20 us.
_PUT_OFF, _PUT_OFF_BUSY = 0.5e-3, 2e-3

_LIBC = ctypes.PyDLL(None)  # keeps the interpreter's lock
_spare: list[int] = []  # eventfds that nothing uses
_spare_timers: list[int] = []
_epoll_wait, _read = _LIBC.epoll_wait, _LIBC.read  # without `argtypes`, which cost 0.3 us
_set_timer = _LIBC.timerfd_settime
_ppoll = ctypes.CDLL(None).ppoll  # gives the lock up; `select`'s functions round to milliseconds


def shorten_slices() -> None:
    """Have the kernel let this thread run sooner after it wakes up; its share of a core stays."""
    if os.sched_getscheduler(0) == os.SCHED_OTHER:  # 0.1 ms, from Linux 6.12 on; usual: 1.4 ms
        own = pack('IIQiIQQQ', 48, 0, 1, os.getpriority(0, 0), 0, 100_000, 0, 0)  # not children's
        _LIBC.syscall(_SCHED_SETATTR, 0, own, 0)  # refused where a sandbox does: as before then


class Descriptors:
    """Waits for descriptors to become readable; for one thread at a time."""

    def __init__(self) -> None:
        self._epoll = select.epoll()
        self._number = self._epoll.fileno()
        self._events, self._count = (ctypes.c_int32 * (_LENGTH * _MOST))(), ctypes.c_uint64()
        self._at_events, self._at_count = ctypes.byref(self._events), ctypes.byref(self._count)
        polled = ctypes.create_string_buffer(pack('ihh', self._number, select.POLLIN, 0))
        self._poll = partial(_ppoll, polled, ctypes.c_ulong(1))
        self._short = False  # whether the last wait was
        self.add = partial(self._epoll.register, eventmask=select.EPOLLIN)
        self.remove = self._epoll.unregister  #: of a descriptor that is open
        self.close = self._epoll.close  #: those that were added stay open

    def ready(self) -> list[int]:
        """Return the descriptors that are readable now, without giving up the lock."""
        found = _epoll_wait(self._number, self._at_events, _MOST, 0)
        return self._events[_PLACE : max(0, found) * _LENGTH : _LENGTH]

    def wait(self, deadline: float) -> list[int]:
        """Wait until a descriptor is readable or the deadline [s]; return those that are."""
        now = begun = time.monotonic()
        look_until = min(deadline, begun + _LOOK) if self._short else begun
        while now < look_until and not self._poll(_timespec(0.0), None):
            now = time.monotonic()
        self._poll(_timespec(max(0.0, deadline - now)), None)
        self._short = time.monotonic() < begun + _SHORT
        return self.ready()

    def take_count(self, descriptor: int) -> int:
        """Return what was counted in an eventfd, and count from 0 again."""
        return self._count.value if _read(descriptor, self._at_count, 8) > 0 else 0


def counter() -> int:
    """Return an eventfd, which counts what is written to it."""
    with suppress(IndexError):
        return _spare.pop()
    return os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)


def retire(descriptor: int) -> None:
    """Keep an eventfd for the next `counter`: it is never closed.

    A listener of DDS that fired late would write into it. The middleware says that none does, once
    it was taken back: Fast DDS calls it, and replaces it, with the same mutex held. And if one did,
    the number would not be somebody else's file, socket or timer: at most another entity of ours
    would be tried in vain. A process holds as many as it has needed at a time.
    """
    with suppress(BlockingIOError):
        os.eventfd_read(descriptor)
    _spare.append(descriptor)


def _timespec(seconds: float) -> bytes:
    return pack('ll', int(seconds), int(seconds % 1.0 * 1e9))


class Leadership:
    """The right to poll, to take what has arrived and to begin callbacks; one thread has it.

    The leader lends it for as long as it calls a callback, and takes it back after. When the call
    lasts, the thread that stands by takes it first. A timer wakes it, and is put off while calls
    are short. A list decides who gets it, without a lock or a system call.
    """

    def __init__(self) -> None:
        self.free = [0.0]  #: when it was lent [s], unless a thread polls
        self._lent = 0.0  # [s] when it was lent
        self._timer = _spare_timers.pop() if _spare_timers else _LIBC.timerfd_create(_MONOTONIC, 0)
        os.set_inheritable(self._timer, False)  # raises OSError where none could be opened
        self._put_off = 0.0  # [s] when the timer may be set again

    def take(self) -> bool:
        """Lead from now on; return False where another thread polls."""
        with suppress(IndexError):
            self.free.pop()
            return True
        return False

    def lend(self, lasting: bool) -> float:
        """Let others take it during a call, at once if that is `lasting`; return the time [s]."""
        now = time.monotonic()
        self._lent = now - LASTING if lasting else now
        self.free.append(now)
        if lasting:
            self.wake_stand_by()
        elif now >= self._put_off:
            put_off = _PUT_OFF_BUSY if now - self._put_off < _PUT_OFF else _PUT_OFF
            self.wake_stand_by(LASTING + put_off, put_off)
        return now

    def take_back(self, lent: float) -> bool:
        """Take back what `lend` has lent; return False where another thread has led since."""
        with suppress(ValueError):
            self.free.remove(lent)
            return True
        return False

    def release(self, seconds: float = 0.0) -> None:
        """Have the thread that stands by wake up, so many seconds from now, and take it."""
        self._lent = 0.0
        self.free.append(0.0)
        self.wake_stand_by(seconds)

    def take_over(self, *, wanted: bool) -> bool:
        """Take it from a callback that lasts, or else wait until this is worth another try."""
        if wanted and self.free:
            left = self._lent + LASTING - time.monotonic()
            if left <= 0:
                return self.take()
            self.wake_stand_by(left)
        os.read(self._timer, 8)
        return False

    def wake_stand_by(self, seconds: float = 0.0, put_off: float = 0.0) -> None:
        """End the wait of the thread that stands by, so many seconds from now.

        A `lend` in the next `put_off` seconds need not set the timer: it expires later than that.
        """
        now = time.monotonic()
        due = bytes(16) + _timespec(now + seconds)
        self._put_off = now + put_off  # no other thread runs from here to the end of the call
        _set_timer(self._timer, _ABSOLUTE, due, None)

    def close(self) -> None:
        """Give it back for good, once no thread stands by."""
        self.release()
        _spare_timers.append(self._timer)  # not closed, as a thread may still set it
