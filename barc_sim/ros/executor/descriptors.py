"""Linux's descriptors that an executor waits for: epoll, eventfd, timerfd.

What is there at once is found and read without giving up the interpreter's lock. Otherwise an
executor that is never idle gives it up every 20 us and has it back before another thread wakes up:
that thread then starves, as it only insists where nobody gives up the lock for a switch interval.
"""

from __future__ import annotations

import ctypes
import os
import platform
import resource
import select
from contextlib import suppress
from math import inf
from struct import Struct, pack
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

_POLL_RESOLUTION = 1e-3  # s
_MOST = 64  # descriptors in one poll
#: struct epoll_event: events, descriptor. It is packed on x86-64 alone.
_EVENT = Struct('=4xi4x') if platform.machine() == 'x86_64' else Struct('=8xi4x')
_COUNT = Struct('=Q')
_MONOTONIC, _ABSOLUTE = 1, 1  # CLOCK_MONOTONIC, TFD_TIMER_ABSTIME

_LIBC = ctypes.PyDLL(None)  # keeps the interpreter's lock
_LIBC.timerfd_settime.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.c_char_p, ctypes.c_void_p)
_epoll_wait, _read = _LIBC.epoll_wait, _LIBC.read
_epoll_wait.argtypes = (ctypes.c_int, ctypes.c_void_p, ctypes.c_int, ctypes.c_int)
_read.argtypes = (ctypes.c_int, ctypes.c_void_p, ctypes.c_size_t)


class Descriptors:
    """Waits for descriptors to become readable; for one thread at a time."""

    def __init__(self) -> None:
        """Wait for none yet."""
        self._epoll = select.epoll()
        self._number = self._epoll.fileno()
        self._events = bytearray(_EVENT.size * _MOST)
        self._count = bytearray(_COUNT.size)
        self._events_at, self._count_at = map(_address, (self._events, self._count))

    def add(self, descriptor: int) -> None:
        """Wait for a descriptor, too."""
        self._epoll.register(descriptor, select.EPOLLIN)

    def remove(self, descriptor: int) -> None:
        """Wait for a descriptor no longer; it must be open."""
        self._epoll.unregister(descriptor)

    def poll(self, seconds: float) -> Iterable[int]:
        """Return the descriptors that are readable, after waiting for one for so long at most."""
        found = _epoll_wait(self._number, self._events_at, _MOST, 0)
        if found <= 0 < seconds:
            if seconds < _POLL_RESOLUTION:
                with suppress(ValueError):  # it has a descriptor above 1023
                    select.select((self._epoll,), (), (), seconds)
                    seconds = 0.0
            return [descriptor for descriptor, _ in self._epoll.poll(seconds, _MOST)]
        unpack, size = _EVENT.unpack_from, _EVENT.size
        return [unpack(self._events, place * size)[0] for place in range(found)]

    def take_count(self, descriptor: int) -> int:
        """Return what was counted in an eventfd, and count from 0 again."""
        if _read(descriptor, self._count_at, _COUNT.size) != _COUNT.size:
            return 0
        (count,) = _COUNT.unpack(self._count)
        return int(count)

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._epoll.closed

    def close(self) -> None:
        """Close the descriptor that waits; not those that it waits for."""
        self._epoll.close()


def eventfd() -> int:
    """Return a descriptor that counts."""
    try:
        return os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
    except OSError:  # the process may have more, if it asks
        _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
        return os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)


def timerfd() -> int:
    """Return a descriptor that is readable when its time has come."""
    return int(_LIBC.timerfd_create(_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC))


def set_time(descriptor: int, due: float) -> None:
    """Set a timerfd's time [ns] of the monotonic clock; inf: never."""
    first = divmod(int(due), 1_000_000_000) if due < inf else (0, 0)
    _LIBC.timerfd_settime(descriptor, _ABSOLUTE, pack('4l', 0, 0, *first), None)


def _address(buffer: bytearray) -> int:
    return ctypes.addressof((ctypes.c_char * len(buffer)).from_buffer(buffer))
