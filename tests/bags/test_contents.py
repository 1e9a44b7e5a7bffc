"""Bags of any recorder: their messages, in order, and what `barc info` prints of them."""

from __future__ import annotations

import json
import os
import shutil
from typing import TYPE_CHECKING

import pytest
import zstandard
from command_line import printed
from mcap.writer import CompressionType, Writer
from rosbags.convert.converter import convert

from barc_sim.bags import mcap_files
from barc_sim.bags.contents import Contents
from barc_sim.bags.messages import BagMessage, Topic, topic
from barc_sim.bags.schemas import types_of
from barc_sim.bags.writer import BagWriter
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path

COUNTS = {'/a': 400, '/b': 40}


@pytest.fixture(scope='module')
def parts(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Return two bags, one after the other, of two topics, whose messages lie out of order."""
    made = []
    topics = [topic(f'/{name}', 'std_msgs/msg/Header') for name in 'ab']
    for begin in (0, 200):
        made.append(tmp_path_factory.mktemp('part'))
        writer = BagWriter(made[-1], metadata={'command': 'test', 'lost_messages': '2'})
        for k in range(begin, begin + 200):
            later = k ^ 1  # each second message before the first
            for each in topics[: 1 + (k % 10 == 0)]:
                data = bytes([0, 1, 0, 0, *later.to_bytes(4, 'little'), *bytes(4), 1, 0, 0, 0, 0])
                writer.write([BagMessage(each, data, 10**9 + 10**7 * later, 0, k)])
        writer.close()
    return made


@pytest.fixture(scope='module')
def ours(parts: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return both as one bag of two files."""
    directory = tmp_path_factory.mktemp('bags') / 'ours'
    directory.mkdir()
    for number, part in enumerate(parts):
        shutil.copy(*part.glob('*.mcap'), directory / f'ours_{number}.mcap')
    return directory


@pytest.fixture(params=['', 'message'], ids=['ours', 'compressed messages'])
def path(request: pytest.FixtureRequest, parts: list[Path], ours: Path, tmp_path: Path) -> Path:
    """Return the bag as we and as rosbag2 write it."""
    if request.param:
        made = tmp_path / 'made'
        convert(parts, made, 'mcap', 9, 'zstd', request.param, None, None, (), (), (), ())
        return made
    return ours


def test_the_messages_of_any_recorder_are_read_in_order(path: Path) -> None:
    contents = Contents(path)
    contents.complete()
    assert (contents.span.start, contents.span.end) == (10**9, 10**9 + 10**7 * 399)
    assert {each.type for each in contents.topics} == {'std_msgs/msg/Header'}
    read = [*contents.in_order()]
    assert {topic.name: count for topic, count in contents.counted} == COUNTS
    stamps = [each.received for each in read if each.topic.name == '/a']
    assert stamps == [10**9 + 10**7 * k for k in range(400)]
    assert all(
        each.data[4:8] == (each.received // 10**7 - 100).to_bytes(4, 'little') for each in read
    )


def test_a_bag_can_be_read_several_times(ours: Path) -> None:
    contents = Contents(ours)  # `barc play --loop` does it for hours
    assert {sum(1 for _ in contents.messages()) for _ in range(60)} == {440}


@pytest.mark.parametrize('time', [0, 10**9 + 1, 10**9 + 10**7 * 150, 10**9 + 10**7 * 399, 10**12])
@pytest.mark.parametrize('cut', [False, True], ids=['whole', 'killed'])
def test_a_bag_is_read_from_a_time_on(ours: Path, tmp_path: Path, time: int, *, cut: bool) -> None:
    path = tmp_path / 'from'
    shutil.copytree(ours, path)
    if cut:
        for file in path.iterdir():
            file.write_bytes(file.read_bytes()[:-200])
    contents = Contents(path)
    expected = [message for message in contents.messages() if message.received >= time]
    assert [*contents.messages(time)] == expected
    assert [*Contents(path).messages(time)] == expected
    assert [*contents.in_order(time)] == sorted(expected, key=lambda message: message.received)


def test_what_lies_before_the_time_is_not_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = BagWriter(tmp_path)
    value = topic('/a', 'std_msgs/msg/Header')
    for k in range(50):
        writer.write([BagMessage(value, bytes(20), k, k, k)])
        writer.flush()  # ends a chunk
    writer.close()
    contents = Contents(tmp_path)
    sizes: list[int] = []
    unpack = mcap_files.unpacked
    monkeypatch.setattr(
        mcap_files, 'unpacked', lambda data, size: sizes.append(size) or unpack(data, size)
    )
    assert [message.received for message in contents.messages(45)] == [45, 46, 47, 48, 49]
    assert len(sizes) == 5


@pytest.mark.parametrize('is_killed', [False, True], ids=['whole', 'killed'])
def test_only_the_wanted_chunks_before_a_time_are_read(tmp_path: Path, *, is_killed: bool) -> None:
    writer = BagWriter(tmp_path)
    often, seldom = (topic(name, 'std_msgs/msg/Header') for name in ('/often', '/seldom'))
    for k in range(50):
        writer.write([BagMessage(often, bytes(20), k, k, k)])
        if k % 20 == 5:
            writer.write([BagMessage(seldom, bytes(20), k, k, k)])
        writer.flush()  # ends a chunk
    writer.close()
    if is_killed:
        for file in tmp_path.glob('*.mcap'):
            file.write_bytes(file.read_bytes()[:-200])
    contents = Contents(tmp_path)
    contents.complete()
    identities = {id(each) for each in contents.topics if each.name == '/seldom'}
    blocks = contents.blocks_before(40, lambda topics, last: bool(identities & topics) and last > 5)
    assert [[message.received for message in block] for block in blocks] == [[25, 25]]


def test_a_file_without_chunks_is_one_block(tmp_path: Path) -> None:
    path = tmp_path / 'plain.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start()
        channel = writer.register_channel('/a', 'cdr', 0)
        for k in range(3):
            writer.add_message(channel, log_time=k, data=bytes(8), publish_time=k)
        writer.finish()
    (block,) = Contents(path).blocks_before(2, lambda *_: True)
    assert [message.received for message in block] == [0, 1, 2]


def test_info_prints_what_is_in_it(path: Path) -> None:
    found = json.loads(printed('info', str(path), '--json'))
    assert (found['messages'], found['duration'], found['damages']) == (440, 3.99, {})
    assert {each['name']: each['messages'] for each in found['topics']} == COUNTS
    out = printed('info', str(path)).splitlines()
    assert '      400 /a [std_msgs/msg/Header]' in out
    assert 'Duration:  3.990000000 s' in out


def test_info_without_a_path_describes_the_newest_bag(
    ours: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / 'bags').symlink_to(ours.parent)
    monkeypatch.chdir(tmp_path)
    assert json.loads(printed('info', '--json'))['path'] == 'bags/ours'
    assert printed('convert') == 'ours_csv\n'
    assert printed('recover', '-o', 'whole').endswith('whole\n')


def test_info_of_a_damaged_bag_counts_what_can_be_read(ours: Path, tmp_path: Path) -> None:
    whole = (ours / 'ours_0.mcap').read_bytes()
    file = tmp_path / 'cut.mcap'
    file.write_bytes(whole[: len(whole) * 9 // 10])
    out = printed('info', str(file)).splitlines()
    assert 'Messages:  220' in out  # the first file's; its summary is gone
    assert any(line.startswith('cut.mcap is unfinished or damaged: ') for line in out)
    assert {'lost_messages: 2', 'command: test'} <= {*out}


@pytest.mark.parametrize('compression', CompressionType)
def test_chunks_of_each_compression_are_read(tmp_path: Path, compression: CompressionType) -> None:
    with (tmp_path / 'a.mcap').open('wb') as stream:
        writer = Writer(stream, compression=compression)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/Bool', 'ros2msg', b'bool data')
        channel = writer.register_channel('/a', 'cdr', schema)
        for k in range(100):
            writer.add_message(channel, k, bytes([0, 1, 0, 0, 1]), k)
        writer.finish()
    assert [message.received for message in Contents(tmp_path).messages()] == [*range(100)]


def test_topics_and_metadata_in_memory_are_bounded_over_all_files(
    parts: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('barc_sim.bags.bounds.MAX_KEPT', 20_000)
    for k in range(20):  # what they repeat counts once
        shutil.copy(*parts[0].glob('*.mcap'), tmp_path / f'run_{k}.mcap')
    assert sum(1 for _ in Contents(tmp_path).messages()) == 20 * 220
    for k in range(20, 40):
        writer = BagWriter(tmp_path)
        writer.attach({'notes': bytes([k]) * 100})
        writer.close()
        writer.file.rename(tmp_path / f'run_{k}.mcap')
    with pytest.raises(UserError, match='bytes of topics, metadata and attached files'):
        Contents(tmp_path)


def test_a_message_that_unpacks_to_too_much_stays_compressed(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path)
    bomb = zstandard.compress(bytes(40 << 20))
    writer.write([BagMessage(topic('/a', 'std_msgs/msg/Header'), bomb, 1, 1, 1)])
    writer.close()
    assert [message.data for message in Contents(tmp_path).messages()] == [bomb]


@pytest.mark.parametrize('read', [True, False], ids=['large bag', 'small bag'])
def test_a_message_is_as_large_as_its_bag_allows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, read: bool
) -> None:
    data = os.urandom(3 << 20) if read else bytes(3 << 20)
    monkeypatch.setattr('barc_sim.bags.bounds.MAX_RECORD', 1 << 20)
    writer = BagWriter(tmp_path)
    writer.write([BagMessage(topic('/map', 'std_msgs/msg/Header'), data, 1, 1, 1)])
    writer.close()
    line = 'chunks left out, as they are damaged or too large: 1'
    assert (line in printed('info', str(tmp_path))) != read
    assert [message.data for message in Contents(tmp_path).messages()] == [data] * read


@pytest.mark.parametrize(
    'fields',
    [
        'string[600] a\nstring[600] b',  # rosbags writes code for each element
        'std_msgs/Header[2000] a\n' + '=' * 80 + '\nMSG: std_msgs/Header\nint8 a',
        'int8 a\n' * 3000,
    ],
    ids=['texts', 'messages', 'fields'],
)
def test_a_definition_far_beyond_those_of_robots_is_refused(fields: str) -> None:
    strange = Topic(name='/a', type='a/msg/B', definition=fields, type_hash='', offered_qos=[])
    with pytest.raises(ValueError, match=r'its (arrays|definition) ha'):
        types_of(strange)


@pytest.mark.parametrize('flip', [-30, -60, -200, -400, -600])
def test_a_damaged_summary_is_not_believed(ours: Path, tmp_path: Path, flip: int) -> None:
    """What it describes is then found by a look at each record."""
    content = bytearray((ours / 'ours_0.mcap').read_bytes())
    content[flip] ^= 0x55
    path = tmp_path / 'flipped_0.mcap'
    path.write_bytes(content)
    contents = Contents(path)
    assert contents.metadata == {'command': 'test', 'lost_messages': '2'}
    assert sum(1 for _ in contents.messages()) == 220
    assert {topic.name for topic in contents.topics} == {'/a', '/b'}


def test_a_whole_file_is_opened_without_a_look_at_its_chunks(ours: Path, tmp_path: Path) -> None:
    content = bytearray((ours / 'ours_0.mcap').read_bytes())
    place = content.index(b'zstd') - 41  # where a chunk begins
    assert content[place] == 6
    content[place : place + 9] = bytes(9)
    path = tmp_path / 'holed_0.mcap'
    path.write_bytes(content)
    contents = Contents(path)
    assert contents.metadata == {'command': 'test', 'lost_messages': '2'}
    assert contents.span.count == 220  # as its summary states
    contents.read_all()
    assert contents.span.count == 0
    assert contents.damages['holed_0.mcap'].unfinished
