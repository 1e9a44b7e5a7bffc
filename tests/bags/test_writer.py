"""The bags that are written, read by readers that are not ours."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import mcap_doctor
import numpy as np
import pytest
import yaml
from made_bags import QOS, VALUE
from mcap.reader import SeekingReader
from mcap.records import (
    Chunk,
    DataEnd,
    Footer,
    McapRecord,
    SummaryOffset,
)
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from barc_sim.bags.appender import AtomicAppender
from barc_sim.bags.file_format import FileFormat
from barc_sim.bags.messages import BagMessage, Topic
from barc_sim.bags.metadata import METADATA_NAME, to_yaml
from barc_sim.bags.writer import BagWriter
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from io import FileIO
    from pathlib import Path

NAME = VALUE.type
TYPES = get_typestore(Stores.EMPTY)
TYPES.register(get_types_from_msg('float64 data', NAME))
OTHER = Topic(
    name='/car/other',
    type=VALUE.type,
    definition=VALUE.definition,
    type_hash=VALUE.type_hash,
    offered_qos=[QOS, {**QOS, 'durability': 'transient_local'}],
)


def encoded(value: float) -> bytes:
    return bytes(TYPES.serialize_cdr(TYPES.types[NAME](data=value), NAME))


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    directory = tmp_path / 'run'
    directory.mkdir()
    return directory


@pytest.fixture
def writer(directory: Path) -> Iterator[BagWriter]:
    writer = BagWriter(directory, metadata={'command': 'a b'})
    yield writer
    writer.close()


def write(writer: BagWriter, topic: Topic, k: int) -> None:
    writer.write([BagMessage(topic, encoded(float(k)), 1000 + k, 900 + k, k)])


def metadata(writer: BagWriter) -> dict[str, Any]:
    text = (writer.directory / 'metadata.yaml').read_text(encoding='utf-8')
    information: dict[str, Any] = yaml.safe_load(text)['rosbag2_bagfile_information']
    return information


def test_rosbags_reads_the_directory_and_agrees_with_the_hash(writer: BagWriter) -> None:
    for k in range(10):
        write(writer, (VALUE, OTHER)[k % 2], k)
    writer.close()
    read: list[tuple[str, int, Any]]
    with AnyReader([writer.directory]) as reader:
        read = [
            (connection.topic, time, reader.deserialize(data, connection.msgtype))
            for connection, time, data in reader.messages()
        ]
        assert reader.message_count == 10
        assert {name: topic.msgcount for name, topic in reader.topics.items()} == writer.counts
    assert [(topic, time, message.data) for topic, time, message in read] == [
        (('/value', '/car/other')[k % 2], 1000 + k, float(k)) for k in range(10)
    ]


def test_metadata_is_version_9_and_covers_the_earliest_to_the_latest_message(
    writer: BagWriter,
) -> None:
    for k in (3, 1, 7, 2):  # a clock may jump back
        write(writer, OTHER, k)
    writer.add_metadata({'steps': '4'})
    writer.close()
    mcap_doctor.check(writer.file)
    span = {
        'duration': {'nanoseconds': 6},
        'starting_time': {'nanoseconds_since_epoch': 1001},
        'message_count': 4,
    }
    assert metadata(writer) == {
        'version': 9,
        'storage_identifier': 'mcap',
        **span,
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': '/car/other',
                    'type': NAME,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': list(OTHER.offered_qos),
                    'type_description_hash': OTHER.type_hash,
                },
                'message_count': 4,
            }
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': ['run_0.mcap'],
        'files': [{'path': 'run_0.mcap', **span}],
        'custom_data': {'command': 'a b', 'steps': '4'},
        'ros_distro': 'jazzy',
    }


@pytest.mark.parametrize(
    'value', ['', 'null', '1.0', 'two\nlines\n', "it's: {odd} # §", 'word ' * 100]
)
def test_any_text_can_be_metadata(writer: BagWriter, value: str) -> None:
    writer.add_metadata({'text': value})
    writer.close()
    assert metadata(writer)['custom_data']['text'] == value
    with AnyReader([writer.directory]):
        pass


def test_a_bag_without_messages_is_whole(writer: BagWriter) -> None:
    writer.close()
    with AnyReader([writer.directory]) as reader:
        assert reader.message_count == 0
    with writer.file.open('rb') as stream:
        summary = SeekingReader(stream, validate_crcs=True).get_summary()
    assert summary is not None
    assert not summary.chunk_indexes
    mcap_doctor.check(writer.file)


def test_numbers_wrap_at_32_bits_and_times_before_1970_become_zero(writer: BagWriter) -> None:
    writer.write([BagMessage(VALUE, encoded(0.0), -5, -(10**18), 2**32 + 5)])
    writer.close()
    with writer.file.open('rb') as stream:
        ((_, _, read),) = SeekingReader(stream).iter_messages()
    assert (read.sequence, read.log_time, read.publish_time) == (5, 0, 0)


def test_a_bag_is_never_overwritten(writer: BagWriter) -> None:
    with pytest.raises(UserError, match=r"run_0.mcap' cannot be made \(File exists\)"):
        BagWriter(writer.directory)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / 'bag' / 'file'


@pytest.fixture
def appender(file: Path) -> Iterator[AtomicAppender]:
    file.parent.mkdir()
    appender = AtomicAppender(file)
    yield appender
    appender.close()


def test_a_block_that_does_not_fit_leaves_the_file_as_it_was_and_can_be_retried(
    appender: AtomicAppender, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    appender.write(b'abc')
    appender.commit()
    put = AtomicAppender.put

    def short(file: FileIO, data: bytes) -> None:
        put(file, data[:4])
        raise OSError(28, 'No space left on device')

    appender.write(b'defghi')
    with monkeypatch.context() as patch:
        patch.setattr(AtomicAppender, 'put', staticmethod(short))
        for _ in range(2):
            with pytest.raises(OSError, match='No space left'):
                appender.commit()
            assert file.read_bytes() == b'abc'
    appender.write(b'jk')
    appender.commit()
    assert file.read_bytes() == b'abcdefghijk'


NAMED = Topic(
    name='/named', type='a/msg/Name', definition='string name\n', type_hash='', offered_qos=[QOS]
)
TOPICS = (VALUE, NAMED, replace(NAMED, name='/also_named'))
MESSAGES = 12_000  # half of them are 1.6 chunks


def random_messages(seed: int) -> Iterator[tuple[int, bytes, int, int, int]]:
    """Yield the topic's index, data, times of reception and publication, and sequence number."""
    random = np.random.default_rng(seed)
    for number in range(MESSAGES // 2):
        received, published = random.integers(2**62, size=2).tolist()
        yield number % 3, random.bytes(random.integers(8, 400)), received, published, number


def make(directory: Path) -> Path:
    writer = BagWriter(directory)
    for seed in (1, 2):
        writer.write([BagMessage(TOPICS[index], *rest) for index, *rest in random_messages(seed)])
        writer.add_metadata({'seed': str(seed)})
        writer.attach({'notes': b'wet'})
    writer.close()
    return writer.file


def make_with_mcap(path: Path, information: object) -> None:
    with path.open('wb') as stream:
        writer = Writer(stream, chunk_size=FileFormat.chunk_size, enable_data_crcs=True)
        writer.start('ros2', 'barc_sim')
        channels: list[int] = []
        schemas = dict.fromkeys((topic.type, topic.definition) for topic in TOPICS)
        for seed in (1, 2):
            for index, data, received, published, number in random_messages(seed):
                if index == len(channels):
                    topic = TOPICS[index]
                    schema = topic.type, topic.definition
                    if not schemas[schema]:
                        text = topic.definition.encode()
                        schemas[schema] = writer.register_schema(topic.type, 'ros2msg', text)
                    qos = to_yaml(topic.offered_qos).rstrip()
                    about = {'offered_qos_profiles': qos, 'topic_type_hash': topic.type_hash}
                    channel = writer.register_channel(topic.name, 'cdr', schemas[schema], about)
                    channels.append(channel)
                writer.add_message(channels[index], received, data, published, number)
            writer.flush()
            writer.add_metadata(METADATA_NAME, {'seed': str(seed)})
            writer.add_attachment(0, 3, 'notes', 'text/plain', b'wet')
        writer.add_metadata('rosbag2', {'serialized_metadata': to_yaml(information)})
        writer.finish()


def all_records(path: Path) -> list[McapRecord]:
    """Return the records but those that checksums and places of the others make different."""
    with path.open('rb') as stream:
        read = StreamReader(stream, emit_chunks=True, validate_crcs=True).records
        return [
            record for record in read if not isinstance(record, (DataEnd, Footer, SummaryOffset))
        ]


def test_a_file_has_the_records_that_mcaps_own_writer_writes(
    directory: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('time.time_ns', lambda: 3)  # of the attachments
    ours, theirs = make(directory), tmp_path / 'theirs.mcap'
    text = (directory / 'metadata.yaml').read_text(encoding='utf-8')
    make_with_mcap(theirs, yaml.safe_load(text)['rosbag2_bagfile_information'])
    mcap_doctor.check(ours)
    expected = all_records(theirs)
    assert sum(isinstance(record, Chunk) for record in expected) == 4
    # The kinds of records in a summary may stand in any order.
    assert sorted(all_records(ours), key=kind) == sorted(expected, key=kind)


def kind(record: McapRecord) -> str:
    return type(record).__name__
