"""One MCAP file of a bag."""

from __future__ import annotations

import time
import zlib
from collections import Counter, defaultdict
from typing import TYPE_CHECKING, Any

from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from barc_sim.bags.chunk import CHUNK_SIZE, ChunkBuilder, to_bytes
from barc_sim.bags.metadata import METADATA_NAME, Span, Topic, to_yaml
from barc_sim.bags.pieces import Pieces

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from mcap.records import McapRecord

MAGIC = b'\x89MCAP0\r\n'  #: begins and ends a file


class BagFile:
    """An MCAP file that is being written in chunks, each with a checksum.

    What `commit` cannot write is kept for the next `commit`.

    Raises
    ------
    OSError
        The file exists or cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.span = Span()
        self.pieces = Pieces(path)
        self.finished = False
        self.on_disk: Counter[str] = Counter()  #: messages that the system has taken, by topic
        self._in_pieces: Counter[str] = Counter()  # of finished chunks
        self.topics: dict[int, Topic] = {}  #: by the ID of their channel
        self._channels: dict[str, int] = {}  # by topic
        self._schemas: dict[tuple[str, str], int] = {}
        self._chunk = ChunkBuilder()
        self._summary: defaultdict[int, bytearray] = defaultdict(bytearray)  # records by opcode
        self._listed: Counter[int] = Counter()  # records in the summary, by opcode
        self._checksum = 0
        self._put(MAGIC)
        self._put(to_bytes(Header(profile='ros2', library='barc_sim')))

    def _put(self, data: bytes) -> None:
        self._checksum = zlib.crc32(data, self._checksum)
        self.pieces.write(data)

    @property
    def size(self) -> int:
        """Length [B], without the chunk in progress."""
        return self.pieces.tell()

    @property
    def counts(self) -> Counter[str]:
        """The number of messages, by topic."""
        return self.on_disk + self._in_pieces + self._in_chunk

    @property
    def _in_chunk(self) -> Counter[str]:
        return Counter({self.topics[id_].name: n for id_, n in self._chunk.counts.items()})

    def add_metadata(self, entries: Mapping[str, str], name: str = METADATA_NAME) -> None:
        """Add metadata of the run."""
        data = to_bytes(Metadata(name=name, metadata=dict(entries)))
        self._list(MetadataIndex(offset=self.size, length=len(data), name=name))
        self._put(data)

    def attach(self, name: str, media_type: str, data: bytes, modified: int = 0) -> None:
        """Attach a file with its time `modified` [ns] since the epoch; 0: unknown."""
        attachment = Attachment(
            create_time=modified,
            log_time=time.time_ns(),
            name=name,
            media_type=media_type,
            data=data,
        )
        record = to_bytes(attachment)
        index = AttachmentIndex(
            offset=self.size,
            length=len(record),
            log_time=attachment.log_time,
            create_time=attachment.create_time,
            data_size=len(data),
            name=name,
            media_type=media_type,
        )
        self._list(index)
        self._put(record)

    def _list(self, record: McapRecord) -> None:
        """Add a record to the summary."""
        data = to_bytes(record)
        self._summary[data[0]] += data
        self._listed[data[0]] += 1

    def add(self, topic: Topic, data: bytes, received: int, published: int, sequence: int) -> bool:
        """Append a message; return whether there is anything to commit."""
        channel = self._channels.get(topic.name) or self._register(topic)
        self._chunk.add(channel, data, received, published, sequence & 0xFFFF_FFFF)
        self.span.add(received)
        if self._chunk.size > CHUNK_SIZE:
            self.end_chunk()
        return self.pieces.waiting

    def _register(self, topic: Topic) -> int:
        """Return the ID of a new channel."""
        schema = topic.type, topic.definition
        if schema not in self._schemas:
            self._schemas[schema] = len(self._schemas) + 1
            self._describe(
                Schema(
                    id=self._schemas[schema],
                    name=topic.type,
                    encoding='ros2msg',
                    data=topic.definition.encode(),
                )
            )
        id_ = self._channels[topic.name] = len(self._channels) + 1
        self.topics[id_] = topic
        qos = to_yaml([dict(qos) for qos in topic.offered_qos]).rstrip()
        self._describe(
            Channel(
                id=id_,
                topic=topic.name,
                message_encoding='cdr',
                schema_id=self._schemas[schema],
                metadata={'offered_qos_profiles': qos, 'topic_type_hash': topic.type_hash},
            )
        )
        return id_

    def _describe(self, record: Schema | Channel) -> None:
        self._chunk.add_record(record)
        self._list(record)

    def end_chunk(self) -> None:
        """End the chunk in progress, so that it can be committed."""
        if in_chunk := self._in_chunk:
            data, index = self._chunk.build(self.size)
            self._put(data)
            self._list(index)
            self._in_pieces += in_chunk
            self._chunk = ChunkBuilder()

    def commit(self) -> None:
        """Write the finished chunks, and close the file if it is finished.

        Raises
        ------
        OSError
            The system refused; the file is whole up to the last commit.
        """
        if self.pieces.waiting:
            self.pieces.commit()
            self.on_disk = self.on_disk + self._in_pieces  # others read it in their threads
            self._in_pieces.clear()
        if self.finished:
            self.pieces.close()

    def finish(self, information: Mapping[str, Any]) -> None:
        """Add the summary, and the bag's metadata, so that rosbag2 can read the file alone."""
        if self.finished:
            return
        self.end_chunk()
        self.add_metadata({'serialized_metadata': to_yaml(information)}, 'rosbag2')
        self._put(to_bytes(DataEnd(self._checksum)))
        self._list(self._statistics())
        self._put_summary()
        self.finished = True

    def _statistics(self) -> Statistics:
        listed, counts = self._listed, self.counts
        return Statistics(
            attachment_count=listed[Opcode.ATTACHMENT_INDEX],
            channel_count=listed[Opcode.CHANNEL],
            channel_message_counts={id_: counts[topic.name] for id_, topic in self.topics.items()},
            chunk_count=listed[Opcode.CHUNK_INDEX],
            message_count=self.span.count,
            metadata_count=listed[Opcode.METADATA_INDEX],
            message_start_time=self.span.start or 0,
            message_end_time=self.span.end,
            schema_count=listed[Opcode.SCHEMA],
        )

    def _put_summary(self) -> None:
        """Write the summary, its records of one kind together, and how to find each kind."""
        start, summary, offsets = self.size, b'', b''
        for opcode, records in sorted(self._summary.items()):
            offsets += to_bytes(SummaryOffset(opcode, start + len(summary), len(records)))
            summary += records
        footer = Footer(start, start + len(summary), summary_crc=0)
        before_checksum = to_bytes(footer)[:-4]
        footer.summary_crc = zlib.crc32(summary + offsets + before_checksum)
        self._put(summary + offsets + to_bytes(footer) + MAGIC)
