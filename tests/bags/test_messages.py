"""Messages in CDR: the time with which one begins, and fields at fixed places."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from barc_sim.bags.messages import fixed_reader, leading_time, split_time
from barc_sim.bags.schemas import definition, share, shipped
from barc_sim.cli.process import has_ros

if TYPE_CHECKING:
    from pathlib import Path

ECU = 'barc_interfaces/msg/ECU'
COMMAND = get_types_from_msg(definition(ECU), ECU)[ECU][1]


@pytest.mark.parametrize(('order', 'mark'), [('<', 1), ('>', 0)])
@pytest.mark.parametrize(
    ('sec', 'nanosec'),
    [(0, 0), (258, 3), (2**31 - 1, 999_999_999), (-1, 5), (-(2**31), 0), (2**31 - 1, 2**32 - 1)],
)
def test_time_is_read_in_either_order_of_bytes_and_split_again(
    order: str, mark: int, sec: int, nanosec: int
) -> None:
    data = bytes([0, mark, 0, 0]) + struct.pack(f'{order}iI', sec, nanosec) + b'more'
    assert leading_time(data) == sec * 10**9 + nanosec
    assert split_time(leading_time(data)) == (sec, nanosec)


@pytest.mark.parametrize('frame', ['', 'map', 'base_link', 'a' * 300])
def test_fields_are_read_in_the_order_asked_for(frame: str) -> None:
    read = fixed_reader(COMMAND, ('servo', 'motor'))
    assert read
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register({ECU: ([], COMMAND)})
    stamp = store.types['builtin_interfaces/msg/Time'](sec=1, nanosec=5)
    header = store.types['std_msgs/msg/Header'](stamp=stamp, frame_id=frame)
    made = store.types[ECU](header=header, motor=1.5, servo=-0.25)
    assert read(bytes(store.serialize_cdr(made, ECU))) == (-0.25, 1.5)
    assert read(bytes(store.serialize_cdr(made, ECU, little_endian=False))) is None


@pytest.mark.parametrize(
    'fields',
    [
        'float64 motor\nfloat64 servo',
        'std_msgs/Header header\nbool motor\nbool servo',  # they follow the frame at once
        'std_msgs/Header header\nfloat64 motor\nstring name\nfloat64 servo',
        'std_msgs/Header header\nfloat64 motor\nbool flag\nfloat64 servo',
        'std_msgs/Header header\nfloat64 motor',
        'builtin_interfaces/Time header\nfloat64 motor\nfloat64 servo',
    ],
)
def test_other_fields_have_no_fixed_places(fields: str) -> None:
    (found,) = get_types_from_msg(fields, 'a/msg/B').values()
    assert fixed_reader(found[1], ('motor', 'servo')) is None


@pytest.mark.skipif(not has_ros(), reason='compares with what ROS has installed')
@pytest.mark.parametrize(('name', 'path'), sorted(shipped()))
def test_definition_is_that_of_ros(name: str, path: Path) -> None:
    package, _, base = name.split('/')
    installed = share(package) / 'msg' / f'{base}.msg'
    assert path.read_text(encoding='utf-8') == installed.read_text(encoding='utf-8')
