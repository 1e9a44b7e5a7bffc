"""Bags of several files: where they are split, what each file has, and what a fault costs."""

from __future__ import annotations

import errno
import os
import random
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from struct import Struct
from typing import TYPE_CHECKING, Any

import mcap_doctor
import pytest
import yaml
from command_line import ENVIRONMENT, wait_for
from hypothesis import given, settings
from hypothesis import strategies as st
from made_bags import VALUE
from mcap.reader import SeekingReader
from rosbags.rosbag2 import Reader

from barc_sim.bags.appender import AtomicAppender
from barc_sim.bags.contents import Contents
from barc_sim.bags.file_format import COMPRESSION_FORMATS, STORAGE_PRESETS, file_format
from barc_sim.bags.messages import BagMessage
from barc_sim.bags.writer import BagWriter
from barc_sim.bags.writer_thread import WriterThread
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from io import FileIO

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
OTHER = replace(VALUE, name='/car/other')
TOPICS = (VALUE, OTHER)
FLOOD = Path(__file__).parents[1] / 'bag_flood.py'


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    directory = tmp_path / 'run'
    directory.mkdir()
    return directory


def message(number: int, received: int | None = None, size: int = 8) -> BagMessage:
    """Return a message whose data cannot be compressed; by default one of a row of each 0.1 s."""
    if received is None:
        received = START + number * SECOND // 10
    data = random.Random(number).randbytes(size)  # noqa: S311 (no secret)
    return BagMessage(TOPICS[number % 2], data, received, received - 5, number)


def write(writer: BagWriter, messages: Iterable[BagMessage]) -> None:
    """Write the messages, each in a chunk of its own."""
    for each in messages:
        writer.write([each])
        writer.flush()


def files_of(directory: Path) -> list[Path]:
    """Return the files of a bag, in order."""
    return sorted(directory.glob('*.mcap'), key=lambda file: int(file.stem.rpartition('_')[2]))


def numbers(path: Path) -> list[int]:
    return [each.number for each in Contents(path).messages()]


def numbers_by_file(directory: Path) -> list[list[int]]:
    return [numbers(file) for file in files_of(directory)]


def information(directory: Path) -> dict[str, Any]:
    text = (directory / 'metadata.yaml').read_text(encoding='utf-8')
    information: dict[str, Any] = yaml.safe_load(text)['rosbag2_bagfile_information']
    return information


# Where a bag is split


def test_a_file_takes_no_message_after_it_has_its_maximum_size(directory: Path) -> None:
    writer = BagWriter(directory, max_size=11_000)
    write(writer, (message(number, size=3000) for number in range(10)))
    writer.close()
    assert numbers_by_file(directory) == [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9]]
    sizes = [file.stat().st_size for file in files_of(directory)]
    assert min(sizes[:-1]) >= 11_000


def test_a_chunk_is_no_larger_than_a_file(directory: Path) -> None:
    writer = BagWriter(directory, max_size=10_000)
    writer.write(message(number, size=2000) for number in range(12))
    writer.close()
    assert numbers_by_file(directory) == [[0, 1, 2, 3, 4], [5, 6, 7, 8, 9], [10, 11]]


def test_a_file_takes_messages_up_to_its_maximum_duration(directory: Path) -> None:
    writer = BagWriter(directory, max_duration=1.0)
    writer.write(message(number) for number in range(25))
    writer.close()
    # rosbag2 splits where a message is later than the file's start and the duration.
    assert numbers_by_file(directory) == [[*range(11)], [*range(11, 22)], [22, 23, 24]]


def test_a_clock_that_jumps_back_moves_the_start_of_the_file(directory: Path) -> None:
    times = [100.0, 100.9, 50.0, 50.8, 51.1, 100.0]
    writer = BagWriter(directory, max_duration=1.0)
    writer.write(message(number, round(seconds * SECOND)) for number, seconds in enumerate(times))
    writer.close()
    assert numbers_by_file(directory) == [[0, 1, 2, 3], [4], [5]]


def test_the_duration_is_that_of_the_clock_on_its_topic(directory: Path) -> None:
    clock = replace(VALUE, name='/clock')
    stamp = Struct('<4siI')
    little_endian = bytes([0, 1, 0, 0])
    messages = [
        BagMessage(topic, data, START + number, START, number)
        for number in range(0, 12, 2)
        for topic, data, number in (
            (clock, stamp.pack(little_endian, number, 0), number),
            (VALUE, b'', number + 1),
        )
    ]
    writer = BagWriter(directory, max_duration=4.0)
    failures: list[str] = []
    thread = WriterThread(
        writer, lambda: [messages.pop(0) for _ in messages[:]], 0, failures.append
    )
    thread.use_sim_time = True
    thread.close()
    assert numbers_by_file(directory) == [[0, 1, 2, 3, 4, 5], [6, 7, 8, 9, 10, 11]]
    assert not failures


def test_split_by_call_ends_a_file(directory: Path) -> None:
    writer = BagWriter(directory)
    for number in range(3):
        writer.write([message(number)])
        writer.split()
    writer.close()
    assert numbers_by_file(directory) == [[0], [1], [2], []]
    for file in files_of(directory):
        mcap_doctor.check(file)


@settings(max_examples=40, deadline=None)
@given(
    rows=st.lists(
        st.lists(
            st.tuples(
                st.integers(0, 3),  # bytes in hundreds
                st.integers(-(10**9), 10**10),  # ns since the last message
            ),
            max_size=20,
        ),
        max_size=8,
    ),
    max_size=st.integers(0, 3000),
    max_duration=st.floats(0.0, 20.0),
    compression=st.sampled_from(COMPRESSION_FORMATS),
    preset=st.sampled_from(STORAGE_PRESETS),
    calls=st.sets(st.integers(0, 8)),
)
def test_a_split_bag_has_the_messages_of_one_that_is_not_split_in_the_same_order(
    tmp_path_factory: pytest.TempPathFactory,
    rows: list[list[tuple[int, int]]],
    max_size: int,
    max_duration: float,
    compression: str,
    preset: str,
    calls: set[int],
) -> None:
    folder = tmp_path_factory.mktemp('bags')
    received = START
    batches: list[list[BagMessage]] = []
    for row in rows:
        batch = []
        for size, step in row:
            received += step
            batch.append(message(len(batches) * 20 + len(batch), received, 100 * size))
        batches.append(batch)

    bags = {'whole': BagWriter, 'split': BagWriter}
    for name in bags:
        (folder / name).mkdir()
    whole = BagWriter(folder / 'whole')
    split = BagWriter(
        folder / 'split',
        file_format=file_format(compression, preset),
        max_size=max_size,
        max_duration=max_duration,
    )
    for number, batch in enumerate(batches):
        for writer in (whole, split):
            writer.write(batch)
            writer.flush()
        if number in calls:
            split.split()
    assert split.on_disk == whole.on_disk
    whole.close()
    split.close()

    def content(name: str) -> list[tuple[str, bytes, int, int, int]]:
        return [(topic.name, *rest) for topic, *rest in Contents(folder / name).messages()]

    assert content('split') == content('whole')
    entries = [information(folder / name) for name in ('whole', 'split')]
    for entry in entries:
        del entry['files'], entry['relative_file_paths']
    assert entries[0] == entries[1]
    assert split.counts == whole.counts == split.on_disk


# What each file has


def test_each_closed_file_is_whole_while_the_next_one_grows(directory: Path) -> None:
    writer = BagWriter(directory, metadata={'command': 'acc'}, max_size=6500)
    writer.attach({'track.json': b'[]'})
    write(writer, (message(number, size=1500) for number in range(10)))
    writer.add_metadata({'graph': '{}'})
    write(writer, (message(number, size=1500) for number in range(10, 20)))

    *closed, _ = files_of(directory)
    assert len(closed) == 4
    for file in closed:
        mcap_doctor.check(file)
        with Reader(file) as reader:
            read = [data for _, _, data in reader.messages()]
        assert len(read) == len(numbers(file))
    assert numbers(directory) == [*range(20)]
    assert not (directory / 'metadata.yaml').exists()
    writer.close()

    metadata = [Contents(file).metadata for file in files_of(directory)]
    assert [each['command'] for each in metadata] == ['acc'] * 5
    assert ['graph' in each for each in metadata] == [False, False, True, True, True]
    attached = [list(Contents(file).attachments) for file in files_of(directory)]
    assert attached == [['track.json'], [], [], [], []]


def test_a_file_describes_itself_for_rosbag2(directory: Path) -> None:
    writer = BagWriter(directory, metadata={'a': 'b'})
    writer.write([message(0), message(2)])
    writer.split()
    writer.write([message(3), message(5)])
    writer.close()
    for file, topic, start in zip(
        files_of(directory),
        ('/value', '/car/other'),
        (START, START + 3 * SECOND // 10),
        strict=True,
    ):
        with file.open('rb') as stream:
            records = [*SeekingReader(stream).iter_metadata()]
        (about,) = [each.metadata for each in records if each.name == 'rosbag2']
        described = yaml.safe_load(about['serialized_metadata'])
        assert described['relative_file_paths'] == [file.name]
        assert described['starting_time'] == {'nanoseconds_since_epoch': start}
        (counted,) = described['topics_with_message_count']
        assert counted['topic_metadata']['name'] == topic
        assert counted['message_count'] == described['message_count'] == 2
        assert described['custom_data'] == {'a': 'b'}


#: What rosbag2 reads, with the type that it asks for: `convert<…>::decode` in
#: rosbag2_storage/include/rosbag2_storage/yaml.hpp, in jazzy and in rolling. A missing key or a
#: value of another type is an error there.
DURATION = {'nanoseconds': int}
TIME = {'nanoseconds_since_epoch': int}
QOS_TIME = {'sec': int, 'nsec': int}
QOS = {
    'history': str,
    'depth': int,
    'reliability': str,
    'durability': str,
    'deadline': QOS_TIME,
    'lifespan': QOS_TIME,
    'liveliness': str,
    'liveliness_lease_duration': QOS_TIME,
    'avoid_ros_namespace_conventions': bool,
}
RULES = {
    'version': int,
    'storage_identifier': str,
    'duration': DURATION,
    'starting_time': TIME,
    'message_count': int,
    'topics_with_message_count': [
        {
            'topic_metadata': {
                'name': str,
                'type': str,
                'serialization_format': str,
                'offered_qos_profiles': [QOS],
                'type_description_hash': str,
            },
            'message_count': int,
        }
    ],
    'relative_file_paths': [str],
    'compression_format': str,
    'compression_mode': str,
    'files': [
        {'path': str, 'starting_time': TIME, 'duration': DURATION, 'message_count': int},
    ],
    'custom_data': dict,
    'ros_distro': str,
}


def check(value: Any, rule: Any) -> None:  # noqa: ANN401 (of YAML)
    """Assert that a value keeps to a rule."""
    if isinstance(rule, dict):
        assert {*value} == {*rule}
        for name, entry in rule.items():
            check(value[name], entry)
    elif isinstance(rule, list):
        assert isinstance(value, list)
        for each in value:
            check(each, rule[0])
    else:
        assert type(value) is rule
        # Every number is read as one of 64 bits, and those of times and counts without a sign.
        assert rule is not int or 0 <= value < 2**63


def test_metadata_of_a_split_bag_keep_to_the_rules_of_rosbag2(directory: Path) -> None:
    writer = BagWriter(directory, metadata={'a': '1'}, max_duration=1.0)
    writer.write(message(number) for number in range(25))
    writer.split()  # the last file has no messages
    writer.close()

    described = information(directory)
    check(described, RULES)
    assert all(isinstance(value, str) for value in described['custom_data'].values())
    assert described['version'] == 9
    assert described['relative_file_paths'] == [f'run_{number}.mcap' for number in range(4)]
    tenth = SECOND // 10
    spans = [
        (each['path'], each['starting_time'], each['duration'], each['message_count'])
        for each in described['files']
    ]
    assert spans == [
        ('run_0.mcap', {'nanoseconds_since_epoch': START}, {'nanoseconds': 10 * tenth}, 11),
        (
            'run_1.mcap',
            {'nanoseconds_since_epoch': START + 11 * tenth},
            {'nanoseconds': 10 * tenth},
            11,
        ),
        (
            'run_2.mcap',
            {'nanoseconds_since_epoch': START + 22 * tenth},
            {'nanoseconds': 2 * tenth},
            3,
        ),
        ('run_3.mcap', {'nanoseconds_since_epoch': 2**63 - 1}, {'nanoseconds': 0}, 0),
    ]
    assert described['starting_time'] == {'nanoseconds_since_epoch': START}
    assert described['duration'] == {'nanoseconds': 24 * tenth}
    assert described['message_count'] == 25
    topics = described['topics_with_message_count']
    assert {each['topic_metadata']['name']: each['message_count'] for each in topics} == {
        '/value': 13,
        '/car/other': 12,
    }


def test_rosbags_reads_a_split_bag_as_one(directory: Path) -> None:
    writer = BagWriter(directory, max_duration=1.0)
    messages = [message(number) for number in range(25)]
    writer.write(messages)
    writer.close()
    with Reader(directory) as reader:
        read = [(each.topic, time, data) for each, time, data in reader.messages()]
        assert reader.message_count == 25
        assert {name: topic.msgcount for name, topic in reader.topics.items()} == writer.counts
    assert read == [(topic.name, received, data) for topic, data, received, _, _ in messages]


@pytest.mark.parametrize('preset', STORAGE_PRESETS)
def test_a_preset_makes_the_file_that_rosbag2_makes(directory: Path, preset: str) -> None:
    writer = BagWriter(directory, file_format=file_format(preset=preset))
    for number in range(100):
        writer.write([BagMessage(VALUE, bytes(20_000), START + number, START, number)])
    writer.close()
    mcap_doctor.check(writer.file)
    assert numbers(directory) == [*range(100)]

    with writer.file.open('rb') as stream:
        reader = SeekingReader(stream, validate_crcs=True)
        summary = reader.get_summary()
    assert summary is not None
    chunks = summary.chunk_indexes
    compression, count = {
        '': ({'zstd'}, 3),
        'none': ({''}, 3),
        'fastwrite': (set(), 0),
        'zstd_fast': ({'zstd'}, 3),
        'zstd_small': ({'zstd'}, 1),
    }[preset]
    assert {chunk.compression for chunk in chunks} == compression
    assert len(chunks) == count


@pytest.mark.parametrize('compression', COMPRESSION_FORMATS)
def test_chunks_are_compressed_as_asked(directory: Path, compression: str) -> None:
    writer = BagWriter(directory, file_format=file_format(compression))
    for number in range(100):
        writer.write([BagMessage(VALUE, bytes(20_000), START + number, START, number)])
    writer.close()
    mcap_doctor.check(writer.file)
    assert numbers(directory) == [*range(100)]
    is_small = writer.file.stat().st_size < 100_000
    assert is_small == (compression != 'none')


# What a fault costs


def full_disk(*_: object, **__: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.fixture
def failures() -> list[str]:
    return []


class Numbers(list[BagMessage]):
    """The waiting messages of a source."""

    def take(self) -> list[BagMessage]:
        """Return and remove all."""
        taken = self.copy()
        self.clear()
        return taken


@pytest.fixture
def source() -> Numbers:
    return Numbers()


@pytest.fixture
def thread(directory: Path, source: Numbers, failures: list[str]) -> Iterator[WriterThread]:
    """Return a thread that is not started, with files of 4000 bytes."""
    thread = WriterThread(
        BagWriter(directory, max_size=4000),
        source.take,
        0,
        failures.append,
        cache_size=10**6,
    )
    yield thread
    thread.close()


def record(thread: WriterThread, source: Numbers, *batch: int) -> None:
    """Write messages, in a chunk of their own."""
    source.extend(message(number, size=1500) for number in batch)
    thread._chunk_due = 0.0  # noqa: SLF001 (as if time had passed)
    thread.write_now()


@pytest.mark.parametrize('refused', ['any data', 'the next file'])
def test_what_the_full_disk_refuses_at_a_boundary_is_written_once_there_is_space(
    thread: WriterThread,
    source: Numbers,
    failures: list[str],
    directory: Path,
    monkeypatch: pytest.MonkeyPatch,
    refused: str,
) -> None:
    record(thread, source, 0, 1, 2)
    put = AtomicAppender.put

    def refuse(file: FileIO, data: bytes) -> None:
        if refused == 'any data' or 'run_1' in str(file.name):
            full_disk()
        put(file, data)

    with monkeypatch.context() as patch:
        patch.setattr(AtomicAppender, 'put', staticmethod(refuse))
        for number in range(3, 6):
            record(thread, source, number)
        assert numbers_by_file(directory) == [[0, 1, 2]]
        assert thread._writer.on_disk == {'/value': 2, '/car/other': 1}  # noqa: SLF001
    record(thread, source, 6)
    record(thread, source, 7)
    thread.close()
    assert numbers(directory) == [*range(8)]
    assert failures == [f"writing to '{directory}' failed: No space left on device"]
    assert not thread.unwritten
    for file in files_of(directory):
        mcap_doctor.check(file)


def test_what_a_disk_that_stays_full_at_a_boundary_refuses_is_counted(
    thread: WriterThread, source: Numbers, directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record(thread, source, 0, 1, 2)
    monkeypatch.setattr(AtomicAppender, 'put', full_disk)
    record(thread, source, 3, 4)
    record(thread, source, 5)
    source.append(message(6))
    thread.close()
    assert numbers(directory) == [0, 1, 2]
    assert thread.unwritten == {'/value': 2, '/car/other': 2}
    assert len(files_of(directory)) == 1


def test_a_split_by_call_that_the_disk_refuses_comes_later(
    thread: WriterThread, source: Numbers, directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record(thread, source, 0)
    with monkeypatch.context() as patch:
        patch.setattr(AtomicAppender, 'put', full_disk)
        with pytest.raises(UserError, match=r'cannot be split yet \(No space left'):
            thread.split()
        assert len(files_of(directory)) == 1
    source.append(message(1))
    thread.close()
    assert numbers_by_file(directory) == [[0], [1]]


def test_all_messages_of_a_folder_that_is_removed_at_a_boundary_are_counted(
    thread: WriterThread, source: Numbers, failures: list[str], directory: Path
) -> None:
    record(thread, source, 0, 1, 2)
    shutil.rmtree(directory)
    record(thread, source, 3, 4)
    record(thread, source, 5)
    thread.close()
    assert failures == [f"writing to '{directory}' failed: No such file or directory"]
    assert thread.unwritten == {'/value': 3, '/car/other': 3}


def test_messages_of_a_closed_file_that_is_removed_are_counted_and_the_rest_is_a_bag(
    thread: WriterThread, source: Numbers, failures: list[str], directory: Path
) -> None:
    for number in range(0, 9, 3):
        record(thread, source, number, number + 1, number + 2)
    first = files_of(directory)[0]
    first.unlink()
    warnings: list[str] = []
    thread._on_warning = warnings.append  # noqa: SLF001
    thread.close(lambda: {'lost_messages': f'{sum(thread.unwritten.values())}'})
    assert thread.unwritten == {'/value': 2, '/car/other': 1}
    assert not failures
    assert [repr(str(first)) in warning for warning in warnings] == [True]
    assert Contents(directory).metadata['lost_messages'] == '3'
    with Reader(directory) as reader:
        assert reader.message_count == 6


@pytest.mark.parametrize('share', [0.0, 0.5, 0.9])
def test_messages_of_a_closed_file_that_is_truncated_are_counted(
    thread: WriterThread, source: Numbers, directory: Path, share: float
) -> None:
    for number in range(6):
        record(thread, source, number)
    first = files_of(directory)[0]
    count = len(numbers(first))
    assert count == 2
    os.truncate(first, int(share * first.stat().st_size))
    left = len(numbers(first)) if share else 0
    thread.close()
    assert sum(thread.unwritten.values()) == count - left
    assert sum(thread._writer.on_disk.values()) == 6 - count + left  # noqa: SLF001


@pytest.mark.parametrize('seed', range(10))
def test_every_closed_file_of_a_killed_recording_is_whole(tmp_path: Path, seed: int) -> None:
    chance = random.Random(seed)  # noqa: S311 (no secret)
    directory = tmp_path / 'run'
    command = [sys.executable, str(FLOOD), str(directory), '300000']
    path = os.pathsep.join([str(FLOOD.parent), ENVIRONMENT['PYTHONPATH']])
    with subprocess.Popen(command, env=os.environ | {'PYTHONPATH': path}) as process:
        wait_for(lambda: len(files_of(directory)) > chance.randint(2, 5))
        time.sleep(chance.uniform(0.0, 0.1))  # at any moment
        process.kill()

    *closed, last = files_of(directory)
    for file in closed:
        mcap_doctor.check(file)
        with Reader(file) as reader:
            assert sum(1 for _ in reader.messages()) == reader.message_count
    recorded = numbers(directory)
    flushed = int.from_bytes((tmp_path / 'flushed').read_bytes(), 'little')
    assert recorded == [*range(len(recorded))]
    assert len(recorded) >= flushed > 0
    assert Contents(last).metadata == {'a': 'b'}
