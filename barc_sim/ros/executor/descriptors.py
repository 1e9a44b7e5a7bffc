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
import resource
import select
from contextlib import suppress
from functools import partial
from math import inf
from struct import pack
from typing import TYPE_CHECKING, TypeVar

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable

Opened = TypeVar('Opened')

_POLL_RESOLUTION = 1e-3  # s
_MOST = 64  # descriptors in one poll
#: The length of a struct epoll_event, and the place of the descriptor in it, both in integers of
#: four bytes. Only x86-64 packs it without gaps.
_LENGTH, _PLACE = (3, 1) if platform.machine() == 'x86_64' else (4, 2)
_COUNT_SIZE = 8  # of an eventfd
_MONOTONIC, _ABSOLUTE = 1, 1  # CLOCK_MONOTONIC, TFD_TIMER_ABSTIME

_LIBC = ctypes.PyDLL(None)  # keeps the interpreter's lock
_LIBC.timerfd_settime.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.c_char_p, ctypes.c_void_p)
_spare: list[int] = []  # eventfds that nothing uses
add_to = os.eventfd_write
_epoll_wait, _read = _LIBC.epoll_wait, _LIBC.read  # without `argtypes`, which cost 0.3 us


class Descriptors:
    """Waits for descriptors to become readable; for one thread at a time."""

    def __init__(self) -> None:
        """Wait for none yet."""
        self._epoll = _opened(select.epoll)
        self._number = self._epoll.fileno()
        self._events, self._count = (ctypes.c_int32 * (_LENGTH * _MOST))(), ctypes.c_uint64()
        self._at_events, self._at_count = ctypes.byref(self._events), ctypes.byref(self._count)
        self._integers = memoryview(self._events).cast('B').cast('i')

    def add(self, descriptor: int) -> None:
        """Wait for a descriptor, too."""
        self._epoll.register(descriptor, select.EPOLLIN)

    def remove(self, descriptor: int) -> None:
        """Wait for a descriptor no longer; it must be open."""
        self._epoll.unregister(descriptor)

    def ready(self) -> list[int]:
        """Return the descriptors that are readable now, without giving up the lock."""
        found = _epoll_wait(self._number, self._at_events, _MOST, 0)
        if found == 1:
            return [self._integers[_PLACE]]
        return self._integers[_PLACE : max(0, found) * _LENGTH : _LENGTH].tolist()

    def wait(self, seconds: float) -> list[int]:
        """Wait up to `seconds` until a descriptor is readable; return those that are."""
        if seconds < _POLL_RESOLUTION:
            with suppress(ValueError):  # it has a descriptor above 1023
                select.select((self._epoll,), (), (), seconds)
                seconds = 0.0
        return [descriptor for descriptor, _ in self._epoll.poll(seconds, _MOST)]

    def take_count(self, descriptor: int) -> int:
        """Return what was counted in an eventfd, and count from 0 again."""
        read = _read(descriptor, self._at_count, _COUNT_SIZE)
        return self._count.value if read == _COUNT_SIZE else 0

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._epoll.closed

    def close(self) -> None:
        """Close the epoll descriptor; those that were added stay open."""
        self._epoll.close()


def counter() -> int:
    """Return an eventfd, which counts what is written to it."""
    with suppress(IndexError):
        return _spare.pop()
    return _opened(partial(os.eventfd, 0, os.EFD_NONBLOCK | os.EFD_CLOEXEC))


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


def timerfd(*, blocking: bool = False) -> int:
    """Return a descriptor that is readable when its time has come."""
    flags = os.O_CLOEXEC if blocking else os.O_CLOEXEC | os.O_NONBLOCK
    return int(_opened(partial(_LIBC.timerfd_create, _MONOTONIC, flags)))


def _opened(create: Callable[[], Opened]) -> Opened:
    """Open a descriptor."""
    with suppress(OSError):
        if (opened := create()) != -1:
            return opened
    allowed, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    raise UserError(
        f'this process may open {allowed} files at a time, and the executor needs one more: '
        'raise the limit with `ulimit -n`, or start fewer nodes in one process'
    )


def set_time(descriptor: int, due: float) -> None:
    """Set a timerfd's time [ns] of the monotonic clock; inf: never."""
    first = divmod(int(due), 1_000_000_000) if due < inf else (0, 0)
    _LIBC.timerfd_settime(descriptor, _ABSOLUTE, pack('4l', 0, 0, *first), None)
