"""Serialized messages (CDR), as far as they are read without deserializing them."""

from __future__ import annotations

from struct import Struct

_ENCAPSULATION = 4  #: [bytes]; the second tells the order of all that follow
_TIME = (Struct('>iI'), Struct('<iI'))  #: big-endian, little-endian
_NANOSECONDS = 1_000_000_000


def leading_time(data: bytes) -> int:
    """Return the time [ns] with which a message begins: a header's stamp, or a clock."""
    sec, nanosec = _TIME[data[1] & 1].unpack_from(data, _ENCAPSULATION)
    return int(sec) * _NANOSECONDS + int(nanosec)
