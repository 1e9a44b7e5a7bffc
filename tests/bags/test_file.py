"""An MCAP file, beside the one that mcap's own writer makes of the same."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import mcap_doctor
import numpy as np
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

from barc_sim.bags.file import CHUNK_SIZE, BagFile
from barc_sim.bags.metadata import METADATA_NAME, Topic, to_yaml

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

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
