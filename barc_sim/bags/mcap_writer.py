"""Writes one MCAP file: chunks of messages, and a summary with their index.

The records follow https://mcap.dev/spec. mcap's writer takes 2.5 us for a message, this one
0.5 us. When the disk is full or the process is killed, the file is whole up to its last block.
"""

from __future__ import annotations

import time
import zlib
from collections import Counter, defaultdict
from struct import Struct
from typing import TYPE_CHECKING

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from zstandard import ZstdCompressor

from barc_sim.bags.appender import AtomicAppender
from barc_sim.bags.file_format import FileFormat
from barc_sim.bags.metadata import Span, information, to_yaml

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from mcap.records import McapRecord

    from barc_sim.bags.messages import MessageFields, Topic


MAGIC = b'\x89MCAP0\r\n'  #: begins and ends a file

_OPCODE_AND_LENGTH = 9  # bytes of each record that its length does not count
#: A message's record before its data: opcode, length, channel, sequence number, time of reception,
#: time of publication.
_MESSAGE = Struct('<BQHIQQ')
_MESSAGE_FIELDS = _MESSAGE.size - _OPCODE_AND_LENGTH  # bytes
# Each is looked up for every message: as names of the module they cost least.
_PACK_MESSAGE = _MESSAGE.pack
_MESSAGE_OPCODE = int(Opcode.MESSAGE)
#: A message index's record before its pairs: opcode, length, channel, length of the pairs.
_INDEX = Struct('<BQHI')

#: Times of reception [ns] that a file accepts, from the first to the last: all, and none.
_ALWAYS = (-(2**63), 2**63)
_NEVER = (0, -1)


class ChunkBuilder:
    """Collects the messages of a chunk, after the schemas and channels that they need."""

    def __init__(self) -> None:
        self.size = 0  #: [B] before compression
        self._records: list[bytes] = []
        #: Time and offset of each message, one after the other, by channel.
        self.pairs: defaultdict[int, list[int]] = defaultdict(list)

    def add_record(self, record: McapRecord) -> None:
        """Add a schema or a channel."""
        data = to_bytes(record)
        self._records.append(data)
        self.size += len(data)

    def add(self, channel: int, data: bytes, number: int, received: int, published: int) -> None:
        """Add a message, with its times of reception and publication [ns] since the epoch."""
        length = _MESSAGE_FIELDS + len(data)
        header = _PACK_MESSAGE(_MESSAGE_OPCODE, length, channel, number, received, published)
        self._records.append(header + data)
        self.pairs[channel] += received, self.size
        self.size += _OPCODE_AND_LENGTH + length

    @property
    def content(self) -> bytes:
        """The records."""
        return b''.join(self._records)

    @property
    def span(self) -> Span:
        """The time span of the messages; there must be some."""
        times = [pairs[::2] for pairs in self.pairs.values()]
        return Span(min(map(min, times)), max(map(max, times)), sum(map(len, times)))

    def build(self, offset: int, file_format: FileFormat) -> tuple[bytes, ChunkIndex]:
        """Return the chunk with its message indexes, and its entry in the file's summary.

        It must have messages.

        Parameters
        ----------
        offset
            The chunk's place in the file [B].
        file_format
            Its compression and checksum.
        """
        content = self.content
        span = self.span
        chunk = Chunk(
            compression=file_format.compression,
            data=_compressed(content, file_format),
            message_start_time=span.start or 0,
            message_end_time=span.end,
            uncompressed_crc=zlib.crc32(content) if file_format.has_chunk_checksums else 0,
            uncompressed_size=len(content),
        )
        records = bytearray(to_bytes(chunk))

        index = ChunkIndex(
            message_start_time=chunk.message_start_time,
            message_end_time=chunk.message_end_time,
            chunk_start_offset=offset,
            chunk_length=len(records),
            message_index_offsets={},
            message_index_length=0,
            compression=chunk.compression,
            compressed_size=len(chunk.data),
            uncompressed_size=chunk.uncompressed_size,
        )
        for channel, pairs in self.pairs.items():
            index.message_index_offsets[channel] = offset + len(records)
            records += _message_index(channel, pairs)
        index.message_index_length = len(records) - index.chunk_length
        return bytes(records), index


def _compressed(content: bytes, file_format: FileFormat) -> bytes:
    if file_format.compression == 'zstd':
        return ZstdCompressor(level=file_format.level).compress(content)
    if file_format.compression == 'lz4':
        import lz4.frame  # noqa: PLC0415 (rarely needed)

        frame: bytes = lz4.frame.compress(content)
        return frame
    return content


def _message_index(channel: int, pairs: Sequence[int]) -> bytes:
    """Return the record of a message index, faster than `MessageIndex.write`."""
    numbers = Struct(f'<{len(pairs)}Q')
    length = _INDEX.size - _OPCODE_AND_LENGTH + numbers.size
    header = _INDEX.pack(Opcode.MESSAGE_INDEX, length, channel, numbers.size)
    return header + numbers.pack(*pairs)


def to_bytes(record: McapRecord) -> bytes:
    """Return a record's bytes in a file."""
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


class McapFileWriter:
    """Writes a new MCAP file; not to be shared among threads.

    All is collected in memory: messages in a chunk, which ends when it is large enough, and ended
    chunks in a block, which `commit` appends to the file, whole or not at all. The first `commit`
    makes the file. `finish` adds the summary to the block, after which there are no more messages.

    Parameters
    ----------
    path
        The file to make.
    file_format
        Compression, checksums and chunks.
    max_size
        Size [B] from which on the file accepts no message; 0: any.
    max_duration
        Likewise the time [ns] after the first message.
    """

    def __init__(
        self,
        path: Path,
        file_format: FileFormat | None = None,
        *,
        max_size: int = 0,
        max_duration: int = 0,
    ) -> None:
        self.path = path
        self._format = file_format or FileFormat()
        self._appender = AtomicAppender(path)

        # When the file is full.
        self._max_size = max_size
        self._max_chunk_size = self._format.chunk_size  # [B], and no more than a file
        if max_size:
            self._max_chunk_size = min(self._max_chunk_size, max_size)
        self._max_duration = max_duration
        self._start: int | None = None  # [ns] the earliest message

        # What the file has: messages that a chunk in progress still collects are not counted.
        self.span = Span()
        self._counts: Counter[int] = Counter()  # number of messages in chunks, by channel
        self._committed: Counter[int] = Counter()  # number of messages in the file, by channel
        self._committed_size = 0  # [B] of the file

        # What the file describes, with the ID of each.
        self._topics: dict[int, Topic] = {}  # by the ID of their channel
        self._channels: dict[int, int] = {}  # by the identity of those topics
        self._schemas: dict[tuple[str, str | None, str], int] = {}

        self._chunk = ChunkBuilder()
        self._summary: defaultdict[int, list[bytes]] = defaultdict(list)  # records by opcode
        self._checksum = 0  # of all data in the file

        self._put(MAGIC)
        self._put(to_bytes(Header(profile='ros2', library='barc_sim')))

    @property
    def in_place(self) -> bool:
        """Whether the file is still where it was made."""
        return self._appender.in_place

    @property
    def is_whole(self) -> bool:
        """Whether the file has the size that was written."""
        return self._appender.is_whole

    @property
    def is_truncated(self) -> bool:
        """Whether another process has cut written data off the file; OSError: it was removed."""
        return self._appender.size_on_disk < self._committed_size

    @property
    def size_on_disk(self) -> int:
        """The size of the file on the disk [B]; OSError: it was removed."""
        return self._appender.size_on_disk

    @property
    def topics(self) -> list[tuple[Topic, int]]:
        """The topics, with the number of their messages in ended chunks."""
        return [(topic, self._counts[channel]) for channel, topic in self._topics.items()]

    @property
    def committed(self) -> dict[str, int]:
        """The number of messages that were written to the file, by topic's name."""
        counts: Counter[str] = Counter()
        for channel, count in self._committed.items():
            counts[self._topics[channel].name] += count
        return dict(counts)

    def put_metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Add a record of metadata after the messages."""
        self.end_chunk()
        data = to_bytes(Metadata(name=name, metadata=dict(entries)))
        index = MetadataIndex(offset=self._appender.position, length=len(data), name=name)
        self._add_to_summary(index)
        self._put(data)

    def attach(self, name: str, data: bytes) -> None:
        """Attach a text file."""
        self.end_chunk()
        file = Attachment(
            create_time=0,  # unknown
            log_time=time.time_ns(),
            name=name,
            media_type='text/plain',
            data=data,
        )
        record = to_bytes(file)
        self._add_to_summary(
            AttachmentIndex(
                offset=self._appender.position,
                length=len(record),
                log_time=file.log_time,
                create_time=file.create_time,
                data_size=len(data),
                name=name,
                media_type=file.media_type,
            )
        )
        self._put(record)

    def write(self, messages: Iterator[MessageFields]) -> MessageFields | None:
        """Append messages up to the first one that the full file does not accept, and return it.

        MCAP has no times before 1970, which another machine's clock may show: they become zero.
        """
        max_chunk_size = self._max_chunk_size
        earliest, latest = self._accepted_times()
        for topic, data, received, published, number in messages:
            if received < 0 or published < 0:
                received = max(received, 0)  # noqa: PLW2901
                published = max(published, 0)  # noqa: PLW2901
            if not earliest <= received <= latest:
                if not self._accepts(received):
                    return topic, data, received, published, number
                earliest, latest = self._accepted_times()

            channel = self._channels.get(id(topic)) or self._channel_of(topic)
            self._chunk.add(channel, data, number & 0xFFFF_FFFF, received, published)
            if self._chunk.size > max_chunk_size:
                self.end_chunk()
                earliest, latest = self._accepted_times()
        return None

    def _accepted_times(self) -> tuple[int, int]:
        """Return the first and the last time of reception [ns] that need no further look."""
        if not self._max_size and not self._max_duration:
            return _ALWAYS
        if self._start is None or self._is_too_large:
            return _NEVER
        if not self._max_duration:
            return _ALWAYS
        return self._start, self._start + self._max_duration

    def _accepts(self, received: int) -> bool:
        """Return whether a message belongs to this file, which then begins with the earliest."""
        if self._start is None:
            self._start = received
            return True
        if self._is_too_large:
            return False
        self._start = min(self._start, received)
        return not self._max_duration or received - self._start <= self._max_duration

    @property
    def _is_too_large(self) -> bool:
        """Whether a file with messages has its maximum size."""
        has_messages = self.span.count > 0
        return has_messages and 0 < self._max_size <= self._appender.position

    def end_chunk(self) -> None:
        """End the chunk in progress, so that it can be committed."""
        counts = {channel: len(pairs) // 2 for channel, pairs in self._chunk.pairs.items()}
        if not counts:
            return

        if self._format.has_chunks:
            data, index = self._chunk.build(self._appender.position, self._format)
            self._add_to_summary(index)
        else:
            data = self._chunk.content
        self._put(data)

        self.span += self._chunk.span
        self._counts.update(counts)
        self._chunk = ChunkBuilder()

    def commit(self) -> None:
        """Write all ended chunks and other records; OSError: that failed, and can be retried."""
        if self._appender.waiting:
            self._appender.commit()
            self._committed = self._counts.copy()  # a new object, as other threads read it
            self._committed_size = self._appender.position

    def finish(self, custom: Mapping[str, str]) -> None:
        """End the chunk in progress and add the summary, to be committed.

        Parameters
        ----------
        custom
            The run's own metadata.
        """
        self.end_chunk()
        about = information([(self.path.name, self.span)], self.topics, custom)
        self.put_metadata('rosbag2', {'serialized_metadata': to_yaml(about)})

        self._put(to_bytes(DataEnd(self._checksum)))
        self._put_summary()
        self._summary.clear()

    def close(self) -> None:
        """Close the file; what was not committed is dropped."""
        self._appender.close()

    def _put(self, data: bytes) -> None:
        """Add data to the file's next block."""
        if self._format.has_checksums:
            self._checksum = zlib.crc32(data, self._checksum)
        self._appender.write(data)

    def _add_to_summary(self, record: McapRecord) -> None:
        data = to_bytes(record)
        opcode = data[0]
        self._summary[opcode].append(data)

    def _channel_of(self, topic: Topic) -> int:
        """Return the ID of an equal topic's channel, or of a new one."""
        for channel, registered in self._topics.items():
            if registered == topic:
                return channel
        return self._register(topic)

    def _register(self, topic: Topic) -> int:
        """Return the ID of a new channel."""
        channel = len(self._topics) + 1
        self._channels[id(topic)] = channel
        self._topics[channel] = topic

        metadata = topic.metadata
        if metadata is None:
            qos = to_yaml([dict(profile) for profile in topic.offered_qos]).rstrip()
            metadata = {'offered_qos_profiles': qos, 'topic_type_hash': topic.type_hash}
        self._describe(
            Channel(
                id=channel,
                topic=topic.name,
                message_encoding=topic.message_encoding,
                schema_id=self._schema(topic),
                metadata=dict(metadata),
            )
        )
        return channel

    def _schema(self, topic: Topic) -> int:
        """Return the ID of a topic's schema; 0: it has none."""
        if topic.schema_encoding is None:
            return 0
        schema = (topic.type, topic.schema_encoding, topic.definition)
        if schema not in self._schemas:
            self._schemas[schema] = len(self._schemas) + 1
            self._describe(
                Schema(
                    id=self._schemas[schema],
                    name=topic.type,
                    encoding=topic.schema_encoding,
                    data=topic.definition.encode(errors='surrogateescape'),
                )
            )
        return self._schemas[schema]

    def _describe(self, record: Schema | Channel) -> None:
        """Add a record to the chunk in progress, before its first message, and to the summary."""
        self._chunk.add_record(record)
        self._add_to_summary(record)

    def _put_summary(self) -> None:
        """Write the summary, grouped by kind of record, and the offset of each group."""
        listed = Counter({opcode: len(records) for opcode, records in self._summary.items()})
        self._add_to_summary(
            Statistics(
                attachment_count=listed[Opcode.ATTACHMENT_INDEX],
                channel_count=listed[Opcode.CHANNEL],
                channel_message_counts={channel: self._counts[channel] for channel in self._topics},
                chunk_count=listed[Opcode.CHUNK_INDEX],
                message_count=self.span.count,
                metadata_count=listed[Opcode.METADATA_INDEX],
                message_start_time=self.span.start or 0,
                message_end_time=self.span.end,
                schema_count=listed[Opcode.SCHEMA],
            )
        )
        start = self._appender.position
        summary = b''
        offsets = b''
        for opcode, records in sorted(self._summary.items()):
            group = b''.join(records)
            offsets += to_bytes(SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group

        footer = Footer(start, start + len(summary), summary_crc=0)
        if self._format.has_checksums:
            before_checksum = to_bytes(footer)[:-4]
            footer.summary_crc = zlib.crc32(summary + offsets + before_checksum)
        self._put(summary + offsets + to_bytes(footer) + MAGIC)
