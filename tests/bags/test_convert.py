"""Bags as tables and as other kinds of bags; and those of killed runs, made whole."""

from __future__ import annotations

import csv
import os
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mcap_doctor
import numpy as np
import pytest
import yaml
from command_line import printed, refused
from made_bags import VALUE
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from barc_sim.__main__ import main as barc
from barc_sim.bags import reader as bag
from barc_sim.bags.contents import Contents
from barc_sim.bags.convert import recover as make_whole
from barc_sim.bags.messages import Message, Topic
from barc_sim.bags.writer import BagWriter
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable

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
    line = refused('convert', str(robot), '-o', str(tmp_path / 'out'), '--topics', '/scam')
    assert line.endswith('no topic to convert: choose --topics of /arm/imu, /said, /scan, /x')
    assert not (tmp_path / 'out').exists()
    (robot / 'metadata.yaml').unlink()
    options = ('--to', 'sqlite3', '-o', str(tmp_path / 'out'))
    assert 'recover it first, or choose --topics' in refused('convert', str(robot), *options)


ATTACHED = {'student/a.py': b'x = 1\n'}


def write(directory: Path, max_duration: float = inf) -> BagWriter:
    directory.mkdir()
    writer = BagWriter(directory, metadata={'command': 'acc'}, max_duration=max_duration)
    writer.attach(ATTACHED)
    for k in range(1000):
        writer.write([Message(VALUE, k.to_bytes(12, 'little'), 1000 + k, 900 + k, k)])
        if k % 100 == 99:
            writer.flush()
    return writer


def kill(writer: BagWriter) -> Path:
    """Leave the bag as a kill would; return it."""
    for file in writer._files:  # noqa: SLF001
        file.appender.close()
    return writer.directory


@pytest.fixture
def killed(tmp_path: Path) -> Path:
    """Return the bag of a run that was killed."""
    return kill(write(tmp_path / 'run'))


def _fifo(path: Path, outside: Path) -> None:  # noqa: ARG001
    os.mkfifo(path)


@pytest.mark.parametrize('make', [Path.symlink_to, _fifo], ids=['link', 'pipe'])
@pytest.mark.parametrize('name', ['.metadata.yaml', 'metadata.yaml', '.run_0.mcap.part', 'any'])
def test_a_bag_with_a_link_or_a_pipe_in_it_is_not_written(
    killed: Path, name: str, make: Callable[[Path, Path], None]
) -> None:
    outside = killed.parent / 'bashrc'
    outside.write_text('mine')
    make(killed / name, outside)
    before = sorted(killed.iterdir())
    with pytest.raises(UserError, match='where a bag has plain files only'):
        make_whole(killed)
    assert outside.read_text() == 'mine'
    assert sorted(killed.iterdir()) == before


def messages(directory: Path) -> list[Message]:
    return [*Contents(directory).messages()]


def test_a_killed_runs_bag_becomes_whole(killed: Path) -> None:
    before = messages(killed)
    found, _ = make_whole(killed)
    assert (found.counts, found.span.count, found.metadata) == (
        {'/value': 1000},
        1000,
        {'command': 'acc'},
    )
    assert messages(killed) == before
    mcap_doctor.check(killed / 'run_0.mcap')
    information = yaml.safe_load((killed / 'metadata.yaml').read_text())
    (topic,) = information['rosbag2_bagfile_information']['topics_with_message_count']
    assert topic['topic_metadata']['offered_qos_profiles'] == VALUE.offered_qos
    assert topic['topic_metadata']['type_description_hash'] == VALUE.type_hash
    assert bag.info(killed) == {'command': 'acc'}
    assert bag.load(killed).attachments == ATTACHED
    assert {file.name for file in killed.iterdir()} == {'run_0.mcap', 'metadata.yaml'}


@pytest.mark.parametrize('cut', [1, 100, 700])
def test_a_cut_off_end_costs_the_chunks_that_it_hits(killed: Path, cut: int) -> None:
    file = killed / 'run_0.mcap'
    file.write_bytes(file.read_bytes()[:-cut])
    before = messages(killed)
    assert 0 < len(before) <= 1000
    assert make_whole(killed)[0].span.count == len(before)
    assert messages(killed) == before
    mcap_doctor.check(file)


def test_a_damaged_chunk_is_left_out_and_the_file_is_kept(killed: Path) -> None:
    file = killed / 'run_0.mcap'
    content = bytearray(file.read_bytes())
    content[content.index(b'zstd', len(content) // 2) + 30] ^= 1
    file.write_bytes(content)
    found, kept = make_whole(killed)
    assert found.span.count == 900
    assert found.damages['run_0.mcap'].unreadable_chunks == 1
    assert [path.read_bytes() for path in kept] == [bytes(content)]
    mcap_doctor.check(file)
    with AnyReader([killed]) as reader:
        assert reader.message_count == 900


def test_a_file_with_a_damaged_length_is_kept(killed: Path) -> None:
    file = killed / 'run_0.mcap'
    content = bytearray(file.read_bytes())
    # The compression's name follows 8 bytes of a chunk's length and 32 of other numbers.
    content[content.index(b'zstd', len(content) // 2) - 40 + 3] ^= 0xFF
    file.write_bytes(content)
    found, kept = make_whole(killed)
    assert 0 < found.span.count < 1000
    assert [path.read_bytes() for path in kept] == [bytes(content)]


def test_a_whole_bag_stays_as_it_is(tmp_path: Path) -> None:
    write(tmp_path / 'run').close()
    before = {file.name: file.read_bytes() for file in (tmp_path / 'run').glob('*.mcap')}
    assert make_whole(tmp_path / 'run')[0].span.count == 1000
    assert before == {file.name: file.read_bytes() for file in (tmp_path / 'run').glob('*.mcap')}


def test_a_bag_of_several_files_becomes_whole(tmp_path: Path) -> None:
    make_whole(kill(write(tmp_path / 'run', 99e-9)))
    assert len([*(tmp_path / 'run').glob('*.mcap')]) == 10
    assert [message.number for message in messages(tmp_path / 'run')] == list(range(1000))
    with AnyReader([tmp_path / 'run']) as reader:
        assert reader.message_count == 1000


def test_a_bag_that_is_being_recorded_is_left_alone(tmp_path: Path) -> None:
    writer = write(tmp_path / 'run')
    with pytest.raises(UserError, match=r"run_0.mcap' is being recorded: end the recording first"):
        make_whole(tmp_path / 'run')
    writer.close()
    make_whole(tmp_path / 'run')


def test_full_disk_leaves_the_bag_unchanged(killed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> int:
        raise OSError(28, 'No space left on device')

    before = (killed / 'run_0.mcap').read_bytes()
    monkeypatch.setattr('barc_sim.bags.writer.write_at', refuse)
    with pytest.raises(UserError, match=r'cannot be recovered \(No space left on device\)'):
        make_whole(killed)
    assert {file.name: file.read_bytes() for file in killed.iterdir()} == {'run_0.mcap': before}


def test_command_prints_what_was_recovered(
    killed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert barc(['recover', str(killed)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        'run_0.mcap: was unfinished; 0 bytes at its end could not be read',
        '     1000 /value',
        '     1000 messages in 0.000 s',
    ]
