"""Stamps of messages: read from CDR, and split."""

from __future__ import annotations

import struct

import pytest

from barc_sim.interfaces.stamps import leading_time, split_time


@pytest.mark.parametrize(('order', 'mark'), [('<', 1), ('>', 0)])
@pytest.mark.parametrize(
    ('sec', 'nanosec'),
    [(0, 0), (258, 3), (2**31 - 1, 999_999_999), (-1, 5), (-(2**31), 0), (2**31 - 1, 2**32 - 1)],
)
def test_a_stamp_is_read_in_both_orders_of_bytes_and_split_again(
    order: str, mark: int, sec: int, nanosec: int
) -> None:
    data = bytes([0, mark, 0, 0]) + struct.pack(f'{order}iI', sec, nanosec) + b'more'
    assert leading_time(data) == sec * 10**9 + nanosec
    assert split_time(leading_time(data)) == (sec, nanosec)
