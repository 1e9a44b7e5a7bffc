"""How threads wait: for Linux's descriptors, and for the right to poll them.

`select.epoll` releases the interpreter's lock at each call. A busy executor then takes it back
before another thread wakes up, and that thread starves. Here only a wait releases the lock:
descriptors that are ready are found and read with the lock held.
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

_MAX_EVENTS = 64  # of one poll
_IS_X86_64 = platform.machine() == 'x86_64'
# The length of a struct epoll_event and the descriptor's place in it, in integers of four bytes:
# only x86-64 packs it without gaps.
_LENGTH = 3 if _IS_X86_64 else 4
_PLACE = 1 if _IS_X86_64 else 2
_SCHED_SETATTR = 314 if _IS_X86_64 else 274  # number of the system call
_CLOCK_MONOTONIC = 1
_TFD_TIMER_ABSTIME = 1

# After a wait shorter than `_SHORT`, the next wait polls for `_SPIN` before it sleeps: a halted
# core takes 50 us to wake up, longer than another process needs for its answer.
_SHORT = 0.25e-3  #: [s]
_SPIN = 40e-6  #: [s]
#: [s] after which a callback counts as lasting: another thread polls meanwhile.
LASTING = 1e-3
# A virtual machine takes 20 us to set the timer.
_PUT_OFF = 0.5e-3  #: [s] minimum between two settings of the timer, after a pause
_PUT_OFF_BUSY = 2e-3  #: [s] the same, while calls follow one another

_LIBC = ctypes.PyDLL(None)  # keeps the interpreter's lock
_spare: list[int] = []  # eventfds that nothing uses
_spare_timers: list[int] = []
# Without `argtypes`, which cost 0.3 us.
_epoll_wait = _LIBC.epoll_wait
_read = _LIBC.read
_set_timer = _LIBC.timerfd_settime
_ppoll = ctypes.CDLL(None).ppoll  # releases the lock; `select`'s functions round to milliseconds


def shorten_slices() -> None:
    """Make the kernel run this thread sooner after it wakes up; its share of a core stays.

    From Linux 6.12 on its slices are 0.1 ms, not 1.4 ms. A sandbox may refuse this.
    """
    if os.sched_getscheduler(0) == os.SCHED_OTHER:
        # The 1: child processes do not inherit it.
        attributes = pack('IIQiIQQQ', 48, 0, 1, os.getpriority(0, 0), 0, 100_000, 0, 0)
        _LIBC.syscall(_SCHED_SETATTR, 0, attributes, 0)


class Descriptors:
    """Waits for descriptors to become readable; for one thread at a time."""

    def __init__(self) -> None:
        self._epoll = select.epoll()
        self._number = self._epoll.fileno()
        self._events = (ctypes.c_int32 * (_LENGTH * _MAX_EVENTS))()
        self._count = ctypes.c_uint64()
        self._at_events = ctypes.byref(self._events)
        self._at_count = ctypes.byref(self._count)
        polled = ctypes.create_string_buffer(pack('ihh', self._number, select.POLLIN, 0))
        self._poll = partial(_ppoll, polled, ctypes.c_ulong(1))
        self._short = False  # whether the last wait was short
        self.add = partial(self._epoll.register, eventmask=select.EPOLLIN)
        self.remove = self._epoll.unregister  #: the descriptor must be open
        self.close = self._epoll.close  #: the descriptors stay open

    def ready(self) -> list[int]:
        """Return the descriptors that are readable now, without a release of the lock."""
        count = _epoll_wait(self._number, self._at_events, _MAX_EVENTS, 0)
        return self._events[_PLACE : max(0, count) * _LENGTH : _LENGTH]

    def wait(self, deadline: float) -> list[int]:
        """Wait for a readable descriptor or the deadline [s]; return the readable descriptors."""
        start = time.monotonic()
        now = start
        spin_until = min(deadline, start + _SPIN) if self._short else start
        while now < spin_until and not self._poll(_timespec(0.0), None):
            now = time.monotonic()
        self._poll(_timespec(max(0.0, deadline - now)), None)
        self._short = time.monotonic() < start + _SHORT
        return self.ready()

    def take_count(self, descriptor: int) -> int:
        """Return the count of an eventfd, and set it to 0."""
        return self._count.value if _read(descriptor, self._at_count, 8) > 0 else 0


def counter() -> int:
    """Return an eventfd, which adds up the numbers that are written to it."""
    with suppress(IndexError):
        return _spare.pop()
    return os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)


def retire(descriptor: int) -> None:
    """Keep an eventfd for the next `counter`: it is never closed.

    A listener of DDS that fired late would write into it. No listener should fire after its
    removal: Fast DDS calls and replaces it with the same mutex held. If one did, its descriptor
    would be no other file, socket or timer: at most an entity of ours would be tried in vain. A
    process keeps as many eventfds as it has ever needed at a time.
    """
    with suppress(BlockingIOError):
        os.eventfd_read(descriptor)
    _spare.append(descriptor)


def _timespec(seconds: float) -> bytes:
    return pack('ll', int(seconds), int(seconds % 1.0 * 1e9))


class Leadership:
    """The right to poll, to take arrivals and to begin callbacks; one thread has it.

    The leader lends it while it calls a callback, and takes it back afterwards. When the call
    lasts, the thread that stands by takes it meanwhile. A timer wakes this thread, and is put off
    while calls are short. The atomic `pop` and `remove` of a list decide which thread gets it,
    without a lock or a system call.
    """

    def __init__(self) -> None:
        self.free = [0.0]  #: when it was lent [s]; empty while a thread leads
        self._lent = 0.0  # [s] when it was lent
        if _spare_timers:
            self._timer = _spare_timers.pop()
        else:
            self._timer = _LIBC.timerfd_create(_CLOCK_MONOTONIC, 0)
        os.set_inheritable(self._timer, False)  # raises OSError if no timer could be opened
        self._put_off = 0.0  # [s] when the timer may be set again

    def take(self) -> bool:
        """Lead from now on; return False if another thread leads."""
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

    def take_over(self, *, wanted: bool) -> bool:
        """Take it from a callback that lasts; otherwise wait until another try makes sense."""
        if wanted and self.free:
            left = self._lent + LASTING - time.monotonic()
            if left <= 0:
                return self.take()
            self.wake_stand_by(left)
        os.read(self._timer, 8)
        return False

    def wake_stand_by(self, seconds: float = 0.0, put_off: float = 0.0) -> None:
        """End the wait of the thread that stands by in `seconds`.

        A `lend` in the next `put_off` seconds need not set the timer, which expires later.
        """
        now = time.monotonic()
        due = bytes(16) + _timespec(now + seconds)
        self._put_off = now + put_off  # no other thread runs from here to the end of the call
        _set_timer(self._timer, _TFD_TIMER_ABSTIME, due, None)

    def close(self) -> None:
        """Give it up for good, once no thread stands by."""
        self.release()
        _spare_timers.append(self._timer)  # not closed, as a thread may still set it
