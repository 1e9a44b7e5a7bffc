"""Bags as tables and as other kinds of bags."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from command_line import printed, refused
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from barc_sim.bags.messages import Message
from barc_sim.bags.recording import Topic
from barc_sim.bags.writer import BagWriter

if TYPE_CHECKING:
    from pathlib import Path

STORE = get_typestore(Stores.ROS2_JAZZY)
SECOND = 10**9


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """Return the bag of somebody else's robot: an Imu, a LaserScan, text, and a broken topic."""
    (tmp_path / 'robot').mkdir()
    writer = BagWriter(tmp_path / 'robot')
    types = STORE.types

    def put(name: str, kind: str, message: Any, k: int) -> None:  # noqa: ANN401 (any type)
        text, _ = STORE.generate_msgdef(kind, ros_version=2)
        topic = Topic(name=name, type=kind, definition=text, type_hash='', offered_qos=[])
        data = bytes(STORE.serialize_cdr(message, kind))
        time = 7 * SECOND + k * SECOND // 2
        writer.write([Message(topic, data, time, time, k)])

    for k in range(3):
        stamp = types['builtin_interfaces/msg/Time'](sec=k, nanosec=5)
        header = types['std_msgs/msg/Header'](stamp=stamp, frame_id='imu, "left"')
        vector = types['geometry_msgs/msg/Vector3'](x=0.1 * k, y=0.0, z=9.8)
        rotation = types['geometry_msgs/msg/Quaternion'](x=0.0, y=0.0, z=0.0, w=1.0)
        nine = np.arange(9.0)
        imu = types['sensor_msgs/msg/Imu'](header, rotation, nine, vector, nine, vector, nine)
        put('/arm/imu', 'sensor_msgs/msg/Imu', imu, k)
        ranges = np.arange(k + 1, dtype=np.float32)
        scan = types['sensor_msgs/msg/LaserScan'](header, *[0.5] * 7, ranges, ranges[:0])
        put('/scan', 'sensor_msgs/msg/LaserScan', scan, k)
        put('/said', 'std_msgs/msg/String', types['std_msgs/msg/String'](f'word {k}'), k)
    broken = Topic(name='/x', type='a/msg/X', definition='no type', type_hash='', offered_qos=[])
    writer.write([Message(broken, bytes(8), 7 * SECOND, 0, 1)])
    writer.close()
    return tmp_path / 'robot'


def test_a_topic_becomes_a_csv_file(robot: Path, tmp_path: Path) -> None:
    out = printed('convert', str(robot), '-o', str(tmp_path / 'out'))
    assert out == f'{tmp_path / "out"}\n'
    assert {path.name for path in (tmp_path / 'out').iterdir()} == {
        'arm.imu.csv', 'scan.csv', 'said.csv',
    }  # fmt: skip
    with (tmp_path / 'out' / 'arm.imu.csv').open(newline='') as file:
        rows = [*csv.DictReader(file)]
    assert [row['t'] for row in rows] == ['0.0', '0.5', '1.0']
    assert rows[1]['received'] == '7500000000'
    assert rows[2]['linear_acceleration.x'] == '0.2'
    assert rows[2]['header.frame_id'] == 'imu, "left"'
    assert rows[0]['orientation_covariance'] == str(np.arange(9.0).tolist())
    with (tmp_path / 'out' / 'scan.csv').open(newline='') as file:
        assert [row['ranges'] for row in csv.DictReader(file)][1] == '[0.0, 1.0]'


def test_events_of_a_service_become_a_table(tmp_path: Path) -> None:
    part = 'a/srv/B_Request'
    text = f'uint8 SENT=1\n{part}[<=1] request\n{"=" * 80}\nMSG: {part}\nbool on\n'
    topic = Topic(name='/b', type='a/srv/B_Event', definition=text, type_hash='', offered_qos=[])
    writer = BagWriter(tmp_path)
    writer.write([Message(topic, bytes([0, 1, 0, 0, 1, 0, 0, 0, 1]), SECOND, SECOND, 1)])
    writer.close()
    printed('convert', str(tmp_path), '-o', str(tmp_path / 'out'))
    assert (tmp_path / 'out' / 'b.csv').read_text().splitlines() == [
        't,received,request', '0.0,1000000000,"[{""on"": true}]"',
    ]  # fmt: skip


def test_topics_become_structs_of_matlab(robot: Path, tmp_path: Path) -> None:
    scipy_io = pytest.importorskip('scipy.io')
    printed('convert', str(robot), '--to', 'mat', '-o', str(tmp_path / 'out.mat'))
    found = scipy_io.loadmat(tmp_path / 'out.mat', simplify_cells=True)
    assert found['arm_imu']['linear_acceleration_x'].tolist() == [0.0, 0.1, 0.2]
    assert found['arm_imu']['orientation_covariance'].shape == (3, 9)
    assert [np.size(each) for each in found['scan']['ranges']] == [1, 2, 3]
    assert found['said']['data'].tolist() == ['word 0', 'word 1', 'word 2']


def test_a_topic_becomes_a_parquet_file(robot: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip('pyarrow.parquet')
    printed('convert', str(robot), '--to', 'parquet', '-o', str(tmp_path / 'out'), '-x', 'said')
    table = parquet.read_table(tmp_path / 'out' / 'scan.parquet')
    assert table['ranges'].to_pylist()[2] == [0.0, 1.0, 2.0]
    assert not (tmp_path / 'out' / 'said.parquet').exists()


@pytest.mark.parametrize('kind', ['ros1', 'sqlite3'])
def test_a_bag_becomes_one_of_another_kind(robot: Path, tmp_path: Path, kind: str) -> None:
    output = tmp_path / ('out.bag' if kind == 'ros1' else 'out')
    printed('convert', str(robot), '--to', kind, '-o', str(output), '--topics', '/scan', '/said')
    with AnyReader([output]) as reader:
        assert {name: each.msgcount for name, each in reader.topics.items()} == {
            '/scan': 3, '/said': 3,
        }  # fmt: skip
        found = [reader.deserialize(data, each.msgtype) for each, _, data in reader.messages()]
    assert [each.data for each in found if hasattr(each, 'data')] == ['word 0', 'word 1', 'word 2']


def test_a_link_to_nothing_is_not_followed(robot: Path, tmp_path: Path) -> None:
    link, victim = tmp_path / 'out.mat', tmp_path / 'victim'
    link.symlink_to(victim)
    line = refused('convert', str(robot), '--to', 'mat', '-o', str(link))
    assert (line.endswith('name a new --output'), victim.exists()) == (True, False)


def test_what_cannot_be_converted_is_one_sentence(robot: Path, tmp_path: Path) -> None:
    assert refused('convert', str(robot), '-o', str(tmp_path)).endswith('name a new --output')
    (robot / 'metadata.yaml').unlink()
    options = ('--to', 'sqlite3', '-o', str(tmp_path / 'out'))
    assert 'recover it first, or choose --topics' in refused('convert', str(robot), *options)
