"""Stamps of messages: nanoseconds since the epoch, and their seconds and nanoseconds apart."""

from __future__ import annotations

from struct import Struct
from typing import Any

NANOSECONDS = 1_000_000_000  #: in a second
_MAX_SECONDS = 2**31 - 1
_STAMP = slice(4, 12)  #: of a serialized message
_TIMES = (Struct('>iI'), Struct('<iI'))  # big-endian, little-endian


def leading_time(data: bytes) -> int:
    """Return the time [ns] at the start of a serialized message: a header's stamp, or a clock."""
    sec, nanosec = _TIMES[data[1] & 1].unpack(data[_STAMP])
    return int(sec) * NANOSECONDS + int(nanosec)


def split_time(stamp: int) -> tuple[int, int]:
    """Return a time [ns] as seconds and nanoseconds; the inverse of `leading_time`.

    A time beyond the maximum of seconds stays in the nanoseconds, as a node may have sent it.
    """
    sec, nanosec = divmod(stamp, NANOSECONDS)
    return (
        (sec, nanosec)
        if sec <= _MAX_SECONDS
        else (_MAX_SECONDS, stamp - _MAX_SECONDS * NANOSECONDS)
    )


def to_nanoseconds(stamp: Any) -> int:  # noqa: ANN401 (a builtin_interfaces/msg/Time of any library)
    """Return the stamp of a message in nanoseconds."""
    nanoseconds: int = stamp.sec * NANOSECONDS + stamp.nanosec
    return nanoseconds
