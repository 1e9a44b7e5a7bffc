"""The bags that are written, read by readers that are not ours."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

import mcap_doctor
import pytest
import yaml
from made_bags import QOS, VALUE
from mcap.reader import SeekingReader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from barc_sim.bags import records as bag_records
from barc_sim.bags.recording import Topic
from barc_sim.bags.writer import BagWriter, FileLimits
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

QOS_AS_ROSBAG2_WRITES_IT = """\
- history: unknown
  depth: 0
  reliability: reliable
  durability: volatile
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: automatic
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false"""
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
    writer.write(topic, encoded(float(k)), received=1000 + k, published=900 + k, sequence=k)


def metadata(writer: BagWriter) -> dict[str, Any]:
    text = (writer.directory / 'metadata.yaml').read_text(encoding='utf-8')
    information: dict[str, Any] = yaml.safe_load(text)['rosbag2_bagfile_information']
    return information


def test_channels_have_quality_of_service_and_hash_as_rosbag2_writes_them(
    writer: BagWriter,
) -> None:
    write(writer, VALUE, 0)
    writer.close()
    with writer.file.open('rb') as stream:
        summary = SeekingReader(stream).get_summary()
    assert summary is not None
    assert [channel.metadata for channel in summary.channels.values()] == [
        {
            'offered_qos_profiles': QOS_AS_ROSBAG2_WRITES_IT,
            'topic_type_hash': VALUE.type_hash,
        }
    ]


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


def test_metadata_is_in_the_file_too(writer: BagWriter) -> None:
    write(writer, VALUE, 0)
    writer.add_metadata({'steps': '1'})
    writer.close()
    with writer.file.open('rb') as stream:
        records = [
            (record.name, record.metadata) for record in SeekingReader(stream).iter_metadata()
        ]
    assert records[:-1] == [('barc_sim', {'command': 'a b'}), ('barc_sim', {'steps': '1'})]
    name, content = records[-1]
    assert name == 'rosbag2'
    assert yaml.safe_load(content['serialized_metadata']) == metadata(writer)


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


def test_sequence_numbers_wrap_at_32_bits(writer: BagWriter) -> None:
    writer.write(VALUE, encoded(0.0), received=1, published=1, sequence=2**32 + 5)
    writer.close()
    with writer.file.open('rb') as stream:
        (read,) = SeekingReader(stream).iter_messages()
    assert read[2].sequence == 5


def test_times_before_1970_become_zero(writer: BagWriter) -> None:
    writer.write(VALUE, encoded(0.0), received=-5, published=-(10**18), sequence=1)
    writer.close()
    with writer.file.open('rb') as stream:
        (read,) = SeekingReader(stream).iter_messages()
    assert (read[2].log_time, read[2].publish_time) == (0, 0)


def test_closing_again_changes_nothing(writer: BagWriter) -> None:
    writer.close()
    before = writer.file.read_bytes()
    writer.close()
    assert writer.file.read_bytes() == before


def test_a_bag_is_never_overwritten(writer: BagWriter) -> None:
    with pytest.raises(UserError, match=r"run_0.mcap' cannot be made \(File exists\)"):
        BagWriter(writer.directory)


@pytest.mark.parametrize('count', [0, 1, 5000])
def test_files_follow_the_mcap_specification(
    writer: BagWriter, directory: Path, count: int
) -> None:
    for k in range(count):
        write(writer, (VALUE, OTHER)[k % 2], k)
        if k % 700 == 0:
            writer.flush()
    writer.close()
    mcap_doctor.check(directory / 'run_0.mcap')


@pytest.mark.parametrize(
    'limits', [FileLimits(size=2000), FileLimits(duration=250e-9)], ids=['size', 'duration']
)
def test_files_are_split_without_losing_a_message(tmp_path: Path, limits: FileLimits) -> None:
    directory = tmp_path / 'run'
    directory.mkdir()
    writer = BagWriter(directory, metadata={'command': 'a b'}, limits=limits)
    for k in range(1000):
        write(writer, (VALUE, OTHER)[k % 2], k)
        if k % 50 == 0:
            writer.flush()
    writer.close()
    files = bag_records.files(directory)
    assert len(files) > 3
    times = []
    for file in files:
        mcap_doctor.check(file)
        with file.open('rb') as stream:
            reader = SeekingReader(stream)
            times += [message.log_time for _, _, message in reader.iter_messages()]
            assert next(iter(reader.iter_metadata())).metadata == {'command': 'a b'}
    assert times == list(range(1000, 2000))
    assert [file.name for file in files] == metadata(writer)['relative_file_paths']
    assert sum(file['message_count'] for file in metadata(writer)['files']) == 1000
    with AnyReader([directory]) as reader:
        assert reader.message_count == 1000


def test_a_next_file_that_cannot_be_made_loses_nothing(tmp_path: Path) -> None:
    directory = tmp_path / 'run'
    directory.mkdir()
    (directory / 'run_1.mcap').mkdir()
    writer = BagWriter(directory, limits=FileLimits(size=1))
    for k in range(10):
        with suppress(FileExistsError):
            write(writer, VALUE, k)
    writer.close()
    mcap_doctor.check(directory / 'run_0.mcap')
    assert metadata(writer)['message_count'] == 10


# Attachments


def attachments(path: Path) -> dict[str, bytes]:
    with path.open('rb') as stream:
        found = SeekingReader(stream, validate_crcs=True).iter_attachments()
        return {attachment.name: attachment.data for attachment in found}


def test_files_are_attached_before_the_first_message(writer: BagWriter) -> None:
    files = {'a.py': b'x = 1\n', 'empty': b''}
    writer.attach(files)
    killed = writer.file.read_bytes()
    for k in range(100):
        write(writer, VALUE, k)
    writer.close()
    mcap_doctor.check(writer.file)
    assert attachments(writer.file) == files
    assert b'x = 1\n' in killed
    assert writer.file.read_bytes().startswith(killed)
