"""Linux's descriptors: eventfds that count, timers, and an epoll that keeps the interpreter's lock.

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
from struct import pack

_MAX_EVENTS = 64  # of one poll
_CLOCK_MONOTONIC = 1
TIMER_ABSTIME = 1  #: for `set_timer`: the time is not from now on

if platform.machine() == 'x86_64':
    _EVENT_LENGTH = 3  # of a struct epoll_event, which is packed without gaps, in int32
    _EVENT_DATA = 1  # the place of the descriptor in it
    _SCHED_SETATTR = 314  # the number of the system call
else:
    _EVENT_LENGTH = 4
    _EVENT_DATA = 2
    _SCHED_SETATTR = 274

#: [s] After a wait shorter than `_SHORT`, the next wait polls for `_SPIN` before it sleeps: a
#: halted core takes 50 us to wake up, longer than another process needs for its answer.
_SPIN = 40e-6
_SHORT = 0.25e-3

_LIBC = ctypes.PyDLL(None)  # keeps the interpreter's lock
_epoll_wait = _LIBC.epoll_wait  # without `argtypes`, which cost 0.3 us
_read = _LIBC.read
_ppoll = ctypes.CDLL(None).ppoll  # releases the lock; `select`'s functions round to milliseconds
set_timer = _LIBC.timerfd_settime
_spare_counters: list[int] = []  # eventfds that nothing uses
_spare_timers: list[int] = []


class Descriptors:
    """Waits for descriptors to become readable; for one thread at a time."""

    def __init__(self) -> None:
        self._epoll = select.epoll()
        self._number = self._epoll.fileno()
        self._was_short = False  # whether the last wait was short

        # Arguments of the system calls, which are made once.
        self._events = (ctypes.c_int32 * (_EVENT_LENGTH * _MAX_EVENTS))()
        self._events_pointer = ctypes.byref(self._events)
        self._count = ctypes.c_uint64()
        self._count_pointer = ctypes.byref(self._count)
        self._polled = ctypes.create_string_buffer(pack('ihh', self._number, select.POLLIN, 0))
        self._one = ctypes.c_ulong(1)

    def add(self, descriptor: int) -> None:
        """Wait for a descriptor, too."""
        self._epoll.register(descriptor, select.EPOLLIN)

    def remove(self, descriptor: int) -> None:
        """Wait for a descriptor no longer; it must be open."""
        self._epoll.unregister(descriptor)

    def close(self) -> None:
        """End the use; the descriptors stay open."""
        self._epoll.close()

    def ready(self) -> list[int]:
        """Return the descriptors that are readable now, without a release of the lock."""
        count = max(0, _epoll_wait(self._number, self._events_pointer, _MAX_EVENTS, 0))
        return self._events[_EVENT_DATA : count * _EVENT_LENGTH : _EVENT_LENGTH]

    def wait(self, deadline: float) -> list[int]:
        """Wait for a readable descriptor or the deadline [s]; return the readable descriptors."""
        start = time.monotonic()
        if self._was_short:
            self._poll_until(min(deadline, start + _SPIN))
        self._sleep(max(0.0, deadline - time.monotonic()))
        self._was_short = time.monotonic() < start + _SHORT
        return self.ready()

    def _poll_until(self, end: float) -> None:
        """Poll without sleep until a descriptor is readable or the time [s] has come."""
        while time.monotonic() < end:
            if self._sleep(0.0):
                return

    def _sleep(self, seconds: float) -> int:
        """Sleep until a descriptor is readable; 0: none is."""
        number: int = _ppoll(self._polled, self._one, timespec(seconds), None)
        return number

    def take_count(self, descriptor: int) -> int:
        """Return the count of an eventfd, and set it to 0."""
        if _read(descriptor, self._count_pointer, 8) > 0:
            return self._count.value
        return 0


def counter() -> int:
    """Return an eventfd, which adds up the numbers that are written to it."""
    with suppress(IndexError):
        return _spare_counters.pop()
    return os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)


def retire_counter(descriptor: int) -> None:
    """Keep an eventfd for the next `counter`: it is never closed.

    A listener of DDS that fired late would write into it. No listener should fire after its
    removal: Fast DDS calls and replaces it with the same mutex held. If one did, its descriptor
    would be no other file, socket or timer: at most an entity of ours would be tried in vain. A
    process keeps as many eventfds as it has ever needed at a time.
    """
    with suppress(BlockingIOError):
        os.eventfd_read(descriptor)
    _spare_counters.append(descriptor)


def timer() -> int:
    """Return a timerfd; OSError: none can be opened."""
    if _spare_timers:
        return _spare_timers.pop()
    descriptor: int = _LIBC.timerfd_create(_CLOCK_MONOTONIC, 0)
    os.set_inheritable(descriptor, False)  # raises OSError if none was opened
    return descriptor


def retire_timer(descriptor: int) -> None:
    """Keep a timerfd for the next `timer`: it is not closed, as a thread may still set it."""
    _spare_timers.append(descriptor)


def timespec(seconds: float) -> bytes:
    """Return a time as the C struct that system calls read."""
    return pack('ll', int(seconds), int(seconds % 1.0 * 1e9))


def shorten_slices() -> None:
    """Make the kernel run this thread sooner after it wakes up; its share of a core stays.

    From Linux 6.12 on its slices are 0.1 ms, not 1.4 ms. A sandbox may refuse this.
    """
    if os.sched_getscheduler(0) != os.SCHED_OTHER:
        return
    # The 1: child processes do not inherit it.
    attributes = pack('IIQiIQQQ', 48, 0, 1, os.getpriority(0, 0), 0, 100_000, 0, 0)
    _LIBC.syscall(_SCHED_SETATTR, 0, attributes, 0)
