"""An MCAP file: its blocks, and its records beside those that mcap's own writer makes."""

from __future__ import annotations

import shutil
from dataclasses import replace
from typing import TYPE_CHECKING

import mcap_doctor
import numpy as np
import pytest
from made_bags import QOS, VALUE
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Chunk,
    DataEnd,
    Footer,
    McapRecord,
    SummaryOffset,
)
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from barc_sim.bags import file as module
from barc_sim.bags.file import CHUNK_SIZE, AtomicAppender, BagFile
from barc_sim.bags.recording import METADATA_NAME, Topic, to_yaml

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / 'bag' / 'file'


@pytest.fixture
def appender(file: Path) -> Iterator[AtomicAppender]:
    file.parent.mkdir()
    appender = AtomicAppender(file)
    yield appender
    appender.close()


def test_a_block_is_written_at_commit(appender: AtomicAppender, file: Path) -> None:
    appender.write(b'abc')
    appender.write(b'de')
    assert (appender.position, file.read_bytes(), appender.waiting) == (5, b'', True)
    appender.commit()
    assert (appender.position, file.read_bytes(), appender.waiting) == (5, b'abcde', False)


def test_block_that_does_not_fit_changes_nothing_and_can_be_tried_again(
    appender: AtomicAppender, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    appender.write(b'abc')
    appender.commit()
    write = module.write_at
    room = [4]

    def short(descriptor: int, data: memoryview, offset: int) -> int:
        if not room[0]:
            raise OSError(28, 'No space left on device')
        written = write(descriptor, data[: room[0]], offset)
        room[0] -= written
        return written

    monkeypatch.setattr(module, 'write_at', short)
    appender.write(b'defghi')
    for _ in range(2):
        with pytest.raises(OSError, match='No space left'):
            appender.commit()
        assert file.read_bytes() == b'abc'
    room[0] = 100
    appender.write(b'jk')
    appender.commit()
    assert file.read_bytes() == b'abcdefghijk'


def test_a_removed_file_is_made_anew(appender: AtomicAppender, file: Path) -> None:
    appender.write(b'abc')
    appender.commit()
    assert appender.in_place
    shutil.rmtree(file.parent)
    assert not appender.in_place
    appender.restore()
    assert appender.in_place
    appender.write(b'de')
    appender.commit()
    assert file.read_bytes() == b'abcde'


def test_a_file_that_was_replaced_is_not_overwritten(appender: AtomicAppender, file: Path) -> None:
    file.unlink()
    file.write_bytes(b'foreign')
    assert not appender.in_place
    with pytest.raises(FileExistsError):
        appender.restore()
    assert file.read_bytes() == b'foreign'


def test_an_existing_file_is_refused(appender: AtomicAppender, file: Path) -> None:
    appender.write(b'abc')
    appender.commit()
    with pytest.raises(FileExistsError):
        AtomicAppender(file)
    assert file.read_bytes() == b'abc'


NAMED = Topic(
    name='/named', type='a/msg/Name', definition='string name\n', type_hash='', offered_qos=[QOS]
)
TOPICS = (VALUE, NAMED, replace(NAMED, name='/also_named'))
ATTACHED = (Attachment, AttachmentIndex)
MESSAGES = 12_000  # half of them are 1.6 chunks


def messages(seed: int) -> Iterator[tuple[int, bytes, int, int, int]]:
    """Yield the topic's index, data, times of reception and publication, and sequence number."""
    random = np.random.default_rng(seed)
    for number in range(MESSAGES // 2):
        received, published = random.integers(2**62, size=2).tolist()
        yield number % 3, random.bytes(random.integers(8, 400)), received, published, number


def make(path: Path) -> None:
    file = BagFile(path)
    for seed in (1, 2):
        for index, *message in messages(seed):
            file.add(TOPICS[index], *message)
        file.end_chunk()
        file.add_metadata({'seed': str(seed)})
        file.attach('notes', 'text/plain', b'wet', 3)
    file.finish({'version': 9})
    file.commit()


def make_with_mcap(path: Path) -> None:
    with path.open('wb') as stream:
        writer = Writer(stream, chunk_size=CHUNK_SIZE, enable_data_crcs=True)
        writer.start('ros2', 'barc_sim')
        channels: list[int] = []
        schemas = dict.fromkeys((topic.type, topic.definition) for topic in TOPICS)
        for seed in (1, 2):
            for index, data, received, published, number in messages(seed):
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
            writer.add_attachment(3, 0, 'notes', 'text/plain', b'wet')
        writer.add_metadata('rosbag2', {'serialized_metadata': to_yaml({'version': 9})})
        writer.finish()


def records(path: Path) -> list[McapRecord]:
    """Return the records but those that checksums and places of the others make different."""
    with path.open('rb') as stream:
        read = StreamReader(stream, emit_chunks=True, validate_crcs=True).records
        return [
            # Attached now, and now.
            replace(record, log_time=0) if isinstance(record, ATTACHED) else record
            for record in read
            if not isinstance(record, (DataEnd, Footer, SummaryOffset))
        ]


def test_a_file_has_the_records_that_mcaps_own_writer_writes(tmp_path: Path) -> None:
    ours, theirs = tmp_path / 'ours.mcap', tmp_path / 'theirs.mcap'
    make(ours)
    make_with_mcap(theirs)
    mcap_doctor.check(ours)
    expected = records(theirs)
    assert sum(isinstance(record, Chunk) for record in expected) == 4
    # The kinds of records in a summary may stand in any order.
    assert sorted(records(ours), key=kind) == sorted(expected, key=kind)


def kind(record: McapRecord) -> str:
    return type(record).__name__
