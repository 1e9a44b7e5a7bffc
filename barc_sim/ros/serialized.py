"""Takes serialized messages from a subscription, with who published each.

rclpy's own `take_message` leaves out the publisher's GID, without which the numbers of several
publishers' messages cannot be told apart; so rcl is asked itself. The structures are those of
Jazzy's rmw and rcutils, which do not change within a distribution.
"""

from __future__ import annotations

import ctypes
from ctypes import addressof, byref, c_bool, c_char_p, c_int64, c_size_t, c_uint64, c_void_p
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rclpy.subscription import Subscription

_TAKEN, _NOTHING_THERE = 0, 401


class Taken(NamedTuple):
    """A message that was received."""

    data: bytes  #: in CDR, with its header
    published: int  #: [ns] since the epoch, by the publisher's clock
    received: int  #: [ns] since the epoch
    number: int  #: the publisher's count of its messages
    publisher: bytes  #: its GID


class _Allocator(ctypes.Structure):  # rcutils_allocator_t
    _fields_ = tuple(
        (name, c_void_p)
        for name in ('allocate', 'deallocate', 'reallocate', 'zero_allocate', 'state')
    )


class _Array(ctypes.Structure):  # rcutils_uint8_array_t
    _fields_ = (
        ('buffer', c_void_p),
        ('length', c_size_t),
        ('capacity', c_size_t),
        ('allocator', _Allocator),
    )


class _Info(ctypes.Structure):  # rmw_message_info_t
    _fields_ = (
        ('source_timestamp', c_int64),
        ('received_timestamp', c_int64),
        ('publication_sequence_number', c_uint64),
        ('reception_sequence_number', c_uint64),
        ('implementation_identifier', c_char_p),  # this and the next: rmw_gid_t
        ('gid', ctypes.c_char * 16),
        ('from_intra_process', c_bool),
    )


class Taker:
    """Takes messages, through one buffer that grows with them; for one thread at a time."""

    def __init__(self) -> None:
        """Allocate nothing yet."""
        rcutils = ctypes.PyDLL('librcutils.so')
        rcutils.rcutils_get_default_allocator.restype = _Allocator
        self._free = rcutils.rcutils_uint8_array_fini
        self._array = _Array(allocator=rcutils.rcutils_get_default_allocator())
        # PyDLL keeps the interpreter's lock: to give it up for 2 us would cost more than that.
        self._take = ctypes.PyDLL('librcl.so').rcl_take_serialized_message
        self._take.argtypes = (c_void_p, c_void_p, c_void_p, c_void_p)

    def take(self, subscription: Subscription) -> Iterator[Taken]:
        """Yield what waits in `subscription`, and what arrives meanwhile.

        Raises
        ------
        RuntimeError
            rcl has failed.
        """
        info = _Info()
        gid = info.__class__.gid
        start = addressof(info) + gid.offset
        array, where = addressof(self._array), addressof(info)
        with subscription.handle:
            pointer = subscription.handle.pointer
            while (result := self._take(pointer, array, where, None)) == _TAKEN:
                yield Taken(
                    ctypes.string_at(self._array.buffer, self._array.length),
                    info.source_timestamp,
                    info.received_timestamp,
                    info.publication_sequence_number,
                    ctypes.string_at(start, gid.size),
                )
        if result != _NOTHING_THERE:
            raise RuntimeError(
                f'rcl_take_serialized_message returned {result} on {subscription.topic_name}'
            )

    def close(self) -> None:
        """Free the buffer."""
        self._free(byref(self._array))
