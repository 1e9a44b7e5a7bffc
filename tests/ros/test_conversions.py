"""The time with which a serialized message begins."""

from __future__ import annotations

import struct

import pytest

from barc_sim.bags.messages import leading_time


@pytest.mark.parametrize(('order', 'mark'), [('<', 1), ('>', 0)])
@pytest.mark.parametrize(('sec', 'nanosec'), [(0, 0), (258, 3), (2**31 - 1, 999_999_999), (-1, 5)])
def test_time_is_read_in_either_order_of_bytes(
    order: str, mark: int, sec: int, nanosec: int
) -> None:
    data = bytes([0, mark, 0, 0]) + struct.pack(f'{order}iI', sec, nanosec) + b'more'
    assert leading_time(data) == sec * 10**9 + nanosec
