"""Messages of a fixed layout, and the time with which a message begins."""

from __future__ import annotations

import struct

import pytest

from barc_sim.bags.cdr import fixed_layout, leading_time

COMMAND = {'header': 'std_msgs/msg/Header', 'motor': 'float64', 'servo': 'float64'}


@pytest.mark.parametrize(('order', 'mark'), [('<', 1), ('>', 0)])
@pytest.mark.parametrize(('sec', 'nanosec'), [(0, 0), (258, 3), (2**31 - 1, 999_999_999), (-1, 5)])
def test_time_is_read_in_either_order_of_bytes(
    order: str, mark: int, sec: int, nanosec: int
) -> None:
    data = bytes([0, mark, 0, 0]) + struct.pack(f'{order}iI', sec, nanosec) + b'more'
    assert leading_time(data) == sec * 10**9 + nanosec


def test_fields_are_read_in_the_order_asked_for() -> None:
    layout = fixed_layout(COMMAND)
    assert layout
    data = layout.pack(5, {'motor': 1.5, 'servo': -0.25})

    assert layout.fits(data)
    assert layout.reader('servo', 'motor')(data) == (-0.25, 1.5)
    assert layout.reader('servo')(data) == -0.25
    assert leading_time(data) == 5


@pytest.mark.parametrize(
    ('sec', 'nanosec'), [(0, 0), (-(2**31), 0), (2**31 - 1, 999_999_999), (2**31 - 1, 2**32 - 1)]
)
def test_any_time_is_packed_as_it_was_read(sec: int, nanosec: int) -> None:
    layout = fixed_layout({'stamp': 'builtin_interfaces/Time'})
    assert layout
    data = bytes([0, 1, 0, 0]) + struct.pack('<iI', sec, nanosec)
    assert layout.pack(leading_time(data), {}) == data


@pytest.mark.parametrize(
    'changed',
    [
        lambda data: data[:12] + b'\4\0\0\0map\0' + data[20:],  # a frame
        lambda data: b'\0\0' + data[2:],  # the other order of bytes
        lambda data: data[:-1],
        lambda _: b'',
    ],
)
def test_bytes_of_another_layout_do_not_fit(changed: object) -> None:
    layout = fixed_layout(COMMAND)
    assert layout
    data = layout.pack(5, {'motor': 1.5, 'servo': -0.25})
    assert not layout.fits(changed(data))  # type: ignore[operator]


@pytest.mark.parametrize(
    'fields',
    [
        {},
        {'data': 'float64'},
        {'header': 'std_msgs/msg/Header', 'flag': 'bool'},  # it follows the frame at once
        {'header': 'std_msgs/msg/Header', 'name': 'string'},
        {'header': 'std_msgs/msg/Header', 'flag': 'bool', 'late': 'float64'},
        {'stamp': 'builtin_interfaces/msg/Time', 'value': 'float64'},
    ],
)
def test_other_messages_have_no_fixed_layout(fields: dict[str, str]) -> None:
    assert fixed_layout(fields) is None
