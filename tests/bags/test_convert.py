"""Bags as tables; and those of killed runs, made whole."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING, Any

import mcap_doctor
import numpy as np
import pytest
import yaml
from command_line import printed, refused
from made_bags import VALUE
from mcap.reader import SeekingReader
from mcap.writer import Writer
from rosbag2_layouts import CUSTOM_DATA, Sent, write_bag
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from barc_sim.bags import reader as bag
from barc_sim.bags.contents import Contents
from barc_sim.bags.messages import BagMessage, Topic
from barc_sim.bags.recovery import recover
from barc_sim.bags.writer import BagWriter
from barc_sim.errors import UserError

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
        writer.write([BagMessage(topic, data, time, time, k)])

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
        put('/words', 'std_msgs/msg/String', types['std_msgs/msg/String'](f'word {k}'), k)
    broken = Topic(name='/x', type='a/msg/X', definition='no type', type_hash='', offered_qos=[])
    writer.write([BagMessage(broken, bytes(8), 7 * SECOND, 0, 1)])
    writer.close()
    return tmp_path / 'robot'


def test_a_topic_becomes_a_csv_file(robot: Path, tmp_path: Path) -> None:
    out = printed('convert', str(robot), '-o', str(tmp_path / 'out'))
    assert out == f'{tmp_path / "out"}\n'
    assert {path.name for path in (tmp_path / 'out').iterdir()} == {
        'arm.imu.csv', 'scan.csv', 'words.csv',
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


def test_topics_with_similar_names_get_separate_tables(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path)
    topics = ('/a-b', '/a_b', '/A_b', '/a/b', '/a.b', '/' + 'é' * 300)
    for k, name in enumerate(topics):
        text = (7).to_bytes(4, 'little') + f'topic {k}'.encode() + b'\0'
        topic = Topic(
            name=name, type='a/msg/B', definition='string a', type_hash='', offered_qos=[]
        )
        writer.write([BagMessage(topic, bytes([0, 1, 0, 0, 8, 0, 0, 0]) + text[4:], k, k, k)])
    writer.close()
    printed('convert', str(tmp_path), '-o', str(tmp_path / 'out'))
    tables = {path.stem: path.read_text().split(',')[-1] for path in (tmp_path / 'out').iterdir()}
    names = ('a_b', 'a_b_', 'A_b__', 'a.b', 'a.b_', 'é' * 60)
    assert tables == {name: f'topic {k}\n' for k, name in enumerate(names)}


def test_events_of_a_service_become_a_table(tmp_path: Path) -> None:
    part = 'a/srv/B_Request'
    text = f'uint8 SENT=1\n{part}[<=1] request\n{"=" * 80}\nMSG: {part}\nbool on\n'
    topic = Topic(name='/b', type='a/srv/B_Event', definition=text, type_hash='', offered_qos=[])
    writer = BagWriter(tmp_path)
    writer.write([BagMessage(topic, bytes([0, 1, 0, 0, 1, 0, 0, 0, 1]), SECOND, SECOND, 1)])
    writer.close()
    printed('convert', str(tmp_path), '-o', str(tmp_path / 'out'))
    assert (tmp_path / 'out' / 'b.csv').read_text().splitlines() == [
        't,received,request', '0.0,1000000000,"[{""on"": true}]"',
    ]  # fmt: skip


def test_a_bag_that_cannot_be_converted_is_refused_in_one_sentence(
    robot: Path, tmp_path: Path
) -> None:
    (tmp_path / 'link').symlink_to(tmp_path / 'victim')
    for output in (tmp_path, tmp_path / 'link'):
        assert refused('convert', str(robot), '-o', str(output)).endswith('name a new --output')
    assert not (tmp_path / 'victim').exists()
    line = refused('convert', str(robot), '-o', str(tmp_path / 'out'), '--topics', '/scam')
    assert line.endswith('no topic to convert: choose --topics of /arm/imu, /scan, /words, /x')
    assert not (tmp_path / 'out').exists()


def others(path: Path) -> list[Any]:
    """Return each channel of a file with its schema, and the data of its messages."""
    with path.open('rb') as stream:
        read = SeekingReader(stream, validate_crcs=True)
        summary = read.get_summary()
        assert summary
        data: dict[int, list[bytes]] = {}
        for _, channel, message in read.iter_messages():
            data.setdefault(channel.id, []).append(message.data)
    found = []
    for channel in summary.channels.values():
        schema = summary.schemas.get(channel.schema_id)
        of = (schema.name, schema.encoding, schema.data) if schema else None
        found.append(
            (channel.topic, channel.message_encoding, channel.metadata, of, data.get(channel.id))
        )
    return sorted(found, key=str)


IDL = (
    b'=' * 80 + b'\nIDL: a/msg/Level\nmodule a { module msg { struct Level { double level; }; }; };'
)


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """Return a bag whose channels have schemas and encodings of all kinds, and two types."""
    folder = tmp_path / 'foreign'
    folder.mkdir()
    level = b'\0\1\0\0' + np.float64(2.0).tobytes()
    with (folder / 'foreign_0.mcap').open('wb') as stream:
        writer = Writer(stream)
        writer.start('', '')
        schemas = {
            'idl': writer.register_schema('a/msg/Level', 'ros2idl', IDL),
            'json': writer.register_schema('Pose', 'jsonschema', b'{"type": "object"}'),
            'protobuf': writer.register_schema('Pose', 'protobuf', bytes(range(256))),
            'empty': writer.register_schema('a/msg/Halt', 'ros2msg', b''),
            'none': 0,
        }
        for topic, encoding, schema, data in (
            ('/idl', 'cdr', 'idl', level),
            ('/json', 'json', 'json', b'{"x": 1}'),
            ('/protobuf', 'protobuf', 'protobuf', b'\x08\1'),
            ('/halt', 'cdr', 'empty', b'\0\1\0\0\0'),
            ('/no_schema', 'cdr', 'none', level),
            ('/no_schema', '', 'none', b''),
            ('/two', 'cdr', 'empty', b'\0\1\0\0\0'),
            ('/two', 'cdr', 'idl', level),
        ):
            of = {'offered_qos_profiles': '', 'by': topic}
            channel = writer.register_channel(topic, encoding, schemas[schema], of)
            for k in range(3):
                writer.add_message(channel, 10 + k, data, 10 + k)
        writer.finish()
    return folder


def test_recover_writes_what_it_read_as_it_was(foreign: Path, tmp_path: Path) -> None:
    printed('recover', str(foreign), '-o', str(tmp_path / 'whole'))
    file = tmp_path / 'whole' / 'whole_0.mcap'
    assert others(file) == others(foreign / 'foreign_0.mcap')
    mcap_doctor.check(file)
    information = yaml.safe_load((tmp_path / 'whole' / 'metadata.yaml').read_text())
    listed = information['rosbag2_bagfile_information']['topics_with_message_count']
    types = [each['topic_metadata']['type'] for each in listed]
    assert types == [
        'a/msg/Level',
        'Pose',
        'Pose',
        'a/msg/Halt',
        '',
        '',
        'a/msg/Halt',
        'a/msg/Level',
    ]


def test_info_and_convert_name_what_they_cannot_decode(
    foreign: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    lines = printed('info', str(foreign)).splitlines()
    assert '        3 /json [Pose] in json' in lines
    assert '        3 /no_schema [no schema] in an unknown encoding' in lines
    assert '        3 /two [a/msg/Level]' in lines
    printed('convert', str(foreign), '-o', str(tmp_path / 'out'))
    assert "messages of /json [Pose] are left out: its messages are 'json'" in caplog.text
    assert 'messages of /no_schema [no schema] are left out' in caplog.text
    names = {path.name for path in (tmp_path / 'out').iterdir()}
    assert names == {'idl.csv', 'halt.csv', 'two.csv', 'two_.csv'}
    assert (tmp_path / 'out' / 'two_.csv').read_text().startswith('t,received,level\n0.0,10,2.0\n')


def test_nothing_to_convert_is_an_error(foreign: Path, tmp_path: Path) -> None:
    line = refused('convert', str(foreign), '-o', str(tmp_path / 'out'), '--topics', 'json')
    assert 'has no message that can be converted of /json: choose other --topics' in line
    assert not (tmp_path / 'out').exists()


ATTACHED = {'student/a.py': b'x = 1\n'}


@pytest.fixture
def killed(tmp_path: Path) -> Path:
    """Return the bag of a run that was killed."""
    directory = tmp_path / 'run'
    directory.mkdir()
    writer = BagWriter(directory, metadata={'command': 'acc'})
    writer.attach(ATTACHED)
    for k in range(1000):
        writer.write([BagMessage(VALUE, k.to_bytes(12, 'little'), 1000 + k, 900 + k, k)])
        if k % 100 == 99:
            writer.flush()
    writer._file.close()  # noqa: SLF001 (as a kill would)
    return directory


def messages(directory: Path) -> list[BagMessage]:
    return [*Contents(directory).messages()]


def recovered(path: Path) -> Path:
    """Recover a bag, which stays as it is, and return the whole one."""
    before = {file.name: file.read_bytes() for file in path.iterdir()}
    read = messages(path)
    output = path.with_name('whole')
    recover(path, output)
    assert {file.name: file.read_bytes() for file in path.iterdir()} == before
    assert messages(output) == read
    mcap_doctor.check(output / 'whole_0.mcap')
    with AnyReader([output]) as reader:
        assert reader.message_count == len(read)
    return output


def test_recover_completes_the_bag_of_a_killed_run(killed: Path) -> None:
    whole = recovered(killed)
    assert [message.number for message in messages(whole)] == list(range(1000))
    information = yaml.safe_load((whole / 'metadata.yaml').read_text())
    (topic,) = information['rosbag2_bagfile_information']['topics_with_message_count']
    assert topic['topic_metadata']['offered_qos_profiles'] == VALUE.offered_qos
    assert topic['topic_metadata']['type_description_hash'] == VALUE.type_hash
    assert bag.info(whole) == {'command': 'acc'}
    assert bag.load(whole).attachments == ATTACHED


@pytest.mark.parametrize('cut', [1, 100, 700])
def test_a_cut_off_end_costs_the_chunks_that_it_hits(killed: Path, cut: int) -> None:
    file = killed / 'run_0.mcap'
    file.write_bytes(file.read_bytes()[:-cut])
    assert len(messages(recovered(killed))) in {900, 1000}


@pytest.mark.parametrize(
    ('place', 'flip', 'left'), [(30, 1, 900), (-37, 0xFF, None)], ids=['data', 'length']
)
def test_a_damaged_chunk_is_left_out(killed: Path, place: int, flip: int, left: int | None) -> None:
    """The compression's name follows 8 bytes of a chunk's length and 32 of other numbers."""
    file = killed / 'run_0.mcap'
    content = bytearray(file.read_bytes())
    content[content.index(b'zstd', len(content) // 2) + place] ^= flip
    file.write_bytes(content)
    count = len(messages(recovered(killed)))
    assert count == left if left else 0 < count < 1000


def test_recover_on_a_full_disk_leaves_no_directory(
    killed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr('barc_sim.bags.appender.AtomicAppender.put', refuse)
    with pytest.raises(UserError, match=r"whole' cannot be written \(No space left"):
        recover(killed, killed.with_name('whole'))
    assert [*killed.parent.iterdir()] == [killed]


def test_command_prints_what_was_recovered(killed: Path) -> None:
    assert printed('recover', str(killed)).splitlines() == [
        'run_0.mcap is unfinished or damaged: all whole records are read',
        '     1000 /value [std_msgs/msg/Float64]',
        '     1000 messages in 0.000 s',
        f'{killed}_recovered',
    ]
    assert refused('recover', str(killed)).endswith('(File exists): name another folder')


def part(folder: Path, numbers: range, *, is_killed: bool = False) -> Path:
    """Make a bag of one file, and return the file."""
    folder.mkdir()
    writer = BagWriter(folder, metadata={'command': 'acc'})
    writer.attach({f'from {numbers[0]}.txt': b'text'})
    for k in numbers:
        writer.write([BagMessage(VALUE, k.to_bytes(12, 'little'), 1000 + k, 900 + k, k)])
        if k % 10 == 9:
            writer.flush()
    if is_killed:
        writer._file.close()  # noqa: SLF001 (as a kill would)
    else:
        writer.close()
    return writer.file


@pytest.fixture
def killed_parts(tmp_path: Path) -> Path:
    """Return the bag of a recorder that was killed in its third file, without metadata.yaml."""
    directory = tmp_path / 'run'
    directory.mkdir()
    for number in range(3):
        numbers = range(100 * number, 100 * (number + 1))
        file = part(tmp_path / f'part{number}', numbers, is_killed=number == 2)
        file.rename(directory / f'run_{number}.mcap')
    return directory


@pytest.mark.parametrize('has_links', [True, False], ids=['same disk', 'another disk'])
def test_of_a_split_bag_recover_writes_only_damaged_files(
    killed_parts: Path, monkeypatch: pytest.MonkeyPatch, *, has_links: bool
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(18, 'Invalid cross-device link')

    if not has_links:
        monkeypatch.setattr('os.link', refuse)
    before = {file.name: file.read_bytes() for file in killed_parts.iterdir()}
    expected = messages(killed_parts)
    output = killed_parts.with_name('whole')

    lines = printed('recover', str(killed_parts), '-o', str(output)).splitlines()

    assert {file.name: file.read_bytes() for file in killed_parts.iterdir()} == before
    assert lines[0].startswith('run_2.mcap is unfinished or damaged: ')
    assert ('a second name' if has_links else 'were copied: 2') in lines[1]
    assert '      300 /value [std_msgs/msg/Float64]' in lines
    assert messages(output) == expected
    assert len(expected) == 300
    files = [output / f'whole_{number}.mcap' for number in range(3)]
    for file in files:
        mcap_doctor.check(file)
    for number in range(2):
        assert files[number].read_bytes() == before[f'run_{number}.mcap']
        assert files[number].samefile(killed_parts / f'run_{number}.mcap') == has_links
    with AnyReader([output]) as reader:
        assert reader.message_count == 300
    information = yaml.safe_load((output / 'metadata.yaml').read_text())
    about = information['rosbag2_bagfile_information']
    assert [file['message_count'] for file in about['files']] == [100, 100, 100]
    assert [file['path'] for file in about['files']] == about['relative_file_paths']
    assert bag.load(output).attachments.keys() == {f'from {100 * k}.txt' for k in range(3)}
    assert bag.info(output) == {'command': 'acc'}


@pytest.mark.parametrize('has_checksum', [True, False])
def test_a_damaged_chunk_in_a_closed_file_is_found(
    killed_parts: Path, *, has_checksum: bool
) -> None:
    file = killed_parts / 'run_0.mcap'
    content = bytearray(file.read_bytes())
    content[content.index(b'zstd', len(content) // 4) + 30] ^= 1
    if not has_checksum:  # as rosbag2's files are
        place = content.rindex(bytes([15, 4, 0, 0, 0, 0, 0, 0, 0])) + 9
        content[place : place + 4] = bytes(4)
    file.write_bytes(content)
    recovery = recover(killed_parts, killed_parts.with_name('whole'))
    assert recovery.linked == 1
    assert recovery.span.count == 290


def test_a_last_file_without_any_message_is_left_out(killed_parts: Path) -> None:
    (killed_parts / 'run_2.mcap').write_bytes(b'')
    output = killed_parts.with_name('whole')
    recovery = recover(killed_parts, output)
    assert recovery.span.count == 200
    assert {file.name for file in output.glob('*.mcap')} == {'whole_0.mcap', 'whole_1.mcap'}


def test_a_split_bag_without_any_message_is_refused(killed_parts: Path) -> None:
    for file in killed_parts.iterdir():
        file.write_bytes(b'')
    assert 'has no message that can be read: name another' in refused('recover', str(killed_parts))
    assert not killed_parts.with_name('run_recovered').exists()


@pytest.mark.parametrize(
    ('storage', 'compression'), [('sqlite3', ''), ('mcap', 'file'), ('mcap', 'message')]
)
def test_recover_makes_plain_mcap_of_what_is_compressed_or_in_sqlite3(
    tmp_path: Path, storage: str, compression: str
) -> None:
    sent = [[Sent('/a', 10 * number + k, f'{k}') for k in range(10)] for number in range(2)]
    path = write_bag(tmp_path / 'run', sent, storage=storage, compression=compression)
    output = tmp_path / 'whole'
    recovery = recover(path, output)
    assert (recovery.linked, recovery.copied) == (0, 0)
    data = [message.data for message in messages(output)]
    assert data == [message.data for file in sent for message in file]
    for number in range(2):
        mcap_doctor.check(output / f'whole_{number}.mcap')
    with AnyReader([output]) as reader:
        assert reader.message_count == 20
    information = yaml.safe_load((output / 'metadata.yaml').read_text())
    assert information['rosbag2_bagfile_information']['custom_data'] == CUSTOM_DATA


def test_a_file_of_a_split_bag_is_recovered_alone(killed_parts: Path) -> None:
    last = killed_parts / 'run_2.mcap'
    lines = printed('recover', str(last)).splitlines()
    assert lines[-1] == str(killed_parts / 'run_2_recovered')
    assert [message.number for message in messages(killed_parts / 'run_2_recovered')] == [
        *range(200, 300)
    ]


def test_a_disk_without_space_for_copies_is_named(
    killed_parts: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(18, 'Invalid cross-device link')

    monkeypatch.setattr('os.link', refuse)
    full = type('Usage', (), {'free': 1 << 20})
    monkeypatch.setattr('barc_sim.bags.recovery.shutil.disk_usage', lambda _: full)
    line = refused('recover', str(killed_parts))
    assert 'cannot be copied' in line
    assert 'only 1 MiB are free' in line
    assert not killed_parts.with_name('run_recovered').exists()
