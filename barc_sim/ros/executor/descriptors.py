"""Linux's descriptors that an executor waits for: epoll, eventfd, timerfd.

`select.epoll` gives up the interpreter's lock at each call. A busy executor then takes the lock
back before another thread wakes up, every 20 us, and the other thread starves: Python makes the
holder give way only after a whole switch interval without such a release. Here the lock is given up
only to wait; what is there at once is found and read with the lock held.
"""

from __future__ import annotations

import ctypes
import os
import platform
import select
from contextlib import suppress
from functools import partial
from struct import pack

_MOST = 64  # descriptors in one poll
#: The length of a struct epoll_event, and the place of the descriptor in it, both in integers of
#: four bytes. Only x86-64 packs it without gaps.
_LENGTH, _PLACE = (3, 1) if platform.machine() == 'x86_64' else (4, 2)
_COUNT_SIZE = 8  # of an eventfd
_MONOTONIC, _ABSOLUTE = 1, 1  # CLOCK_MONOTONIC, TFD_TIMER_ABSTIME

_LIBC = ctypes.PyDLL(None)  # keeps the interpreter's lock
_spare: list[int] = []  # eventfds that nothing uses
_epoll_wait, _read = _LIBC.epoll_wait, _LIBC.read  # without `argtypes`, which cost 0.3 us
_wait = ctypes.CDLL(None).ppoll  # gives the lock up; `select`'s functions round to milliseconds


class Descriptors:
    """Waits for descriptors to become readable; for one thread at a time."""

    def __init__(self) -> None:
        """Wait for none yet."""
        self._epoll = select.epoll()
        self._number = self._epoll.fileno()
        self._events, self._count = (ctypes.c_int32 * (_LENGTH * _MOST))(), ctypes.c_uint64()
        self._at_events, self._at_count = ctypes.byref(self._events), ctypes.byref(self._count)
        self._integers = memoryview(self._events).cast('B').cast('i')
        self._polled = ctypes.create_string_buffer(pack('ihh', self._number, select.POLLIN, 0))
        self.add = partial(self._epoll.register, eventmask=select.EPOLLIN)
        self.remove = self._epoll.unregister  #: of a descriptor that is open

    def ready(self) -> list[int]:
        """Return the descriptors that are readable now, without giving up the lock."""
        found = _epoll_wait(self._number, self._at_events, _MOST, 0)
        if found == 1:
            return [self._integers[_PLACE]]
        return self._integers[_PLACE : max(0, found) * _LENGTH : _LENGTH].tolist()

    def wait(self, seconds: float) -> list[int]:
        """Wait up to `seconds` until a descriptor is readable; return those that are."""
        _wait(self._polled, ctypes.c_ulong(1), _timespec(seconds), None)
        return self.ready()

    def take_count(self, descriptor: int) -> int:
        """Return what was counted in an eventfd, and count from 0 again."""
        read = _read(descriptor, self._at_count, _COUNT_SIZE)
        return self._count.value if read == _COUNT_SIZE else 0

    def close(self) -> None:
        """Close the epoll descriptor; those that were added stay open."""
        self._epoll.close()


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


def timerfd() -> int:
    """Return a descriptor that can be read when its time has come."""
    timer = int(_LIBC.timerfd_create(_MONOTONIC, 0))
    os.set_inheritable(timer, False)  # raises OSError where none could be opened
    return timer


def set_time(descriptor: int, due: float) -> None:
    """Set a timerfd's time [s] of the monotonic clock."""
    _LIBC.timerfd_settime(descriptor, _ABSOLUTE, bytes(16) + _timespec(due), None)


def _timespec(seconds: float) -> bytes:
    return pack('ll', int(seconds), int(seconds % 1.0 * 1e9))
