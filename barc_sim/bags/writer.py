"""Writes a rosbag2 bag: a directory with MCAP files and their metadata.yaml.

The records follow https://mcap.dev/spec. mcap's writer takes 2.5 us for a message, this one
0.5 us. When the disk is full or the process is killed, the file is whole up to its last block.
"""

from __future__ import annotations

import errno
import os
import time
import zlib
from array import array
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

from barc_sim.bags.metadata import METADATA_NAME, Span, information, to_yaml, write_metadata
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from mcap.records import McapRecord

    from barc_sim.bags.messages import MessageFields, Topic


CHANGED = 'another process has changed its file'
MAGIC = b'\x89MCAP0\r\n'  #: begins and ends a file
#: [B] The maximum size of a chunk, as in rosbag2. A file's summary, in memory until the file is
#: closed, needs about 140 bytes for each chunk. zstd reduces a chunk to 40 %, in 0.6 us a message.
CHUNK_SIZE = 768 * 1024

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


class AtomicAppender:
    """Collects a block in memory, and appends it to a new file, whole or not at all.

    If `commit` fails, the file is as before, the block is kept, and `commit` can be tried again. It
    fails for good once another process has changed the file's size.

    Parameters
    ----------
    path
        The file to make.

    Raises
    ------
    OSError
        The file exists or cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._waiting: list[bytes] = []
        self._size = 0  # of the file
        self.position = 0  #: [B] the length of the file with the block
        # In this mode a file that another process has truncated gets no hole.
        self._file = open(path, 'xb', buffering=0, opener=_open_to_append)  # noqa: SIM115
        self._status = os.fstat(self._file.fileno())

    def write(self, data: bytes) -> None:
        """Append to the block."""
        self._waiting.append(data)
        self.position += len(data)

    @property
    def waiting(self) -> bool:
        """Whether there is a block to commit."""
        return bool(self._waiting)

    def commit(self) -> None:
        """Append the block to the file; OSError: that failed, or another process has changed it."""
        block = b''.join(self._waiting)
        self._waiting = [block]
        if not self.is_whole:
            raise OSError(errno.ESTALE, CHANGED)
        try:
            self.put(block)
        except OSError:
            self._file.truncate(self._size)
            raise
        self._size += len(block)
        self._waiting = []

    def put(self, data: bytes) -> None:
        """Write to the end of the file, in as many parts as the system needs."""
        rest = memoryview(data)
        while rest:
            written = self._file.write(rest)
            rest = rest[written:]

    @property
    def in_place(self) -> bool:
        """Whether the file is still where it was made, also after `close`."""
        try:
            return os.path.samestat(self._path.stat(), self._status)
        except OSError:
            return False

    @property
    def size_on_disk(self) -> int:
        """The size of the file [B], which another process can have changed."""
        return self._path.stat().st_size

    @property
    def is_whole(self) -> bool:
        """Whether the file has the size that was written."""
        return os.fstat(self._file.fileno()).st_size == self._size

    def close(self) -> None:
        """Close the file; a block that was not committed is dropped."""
        self._file.close()


def _open_to_append(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_APPEND, 0o666)


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

    def build(self, offset: int) -> tuple[bytes, ChunkIndex]:
        """Return the chunk with its message indexes, and its entry in the file's summary.

        It must have messages.

        Parameters
        ----------
        offset
            The chunk's place in the file [B].
        """
        content = b''.join(self._records)
        times = [pairs[::2] for pairs in self.pairs.values()]
        chunk = Chunk(
            compression='zstd',
            data=ZstdCompressor().compress(content),
            message_start_time=min(map(min, times)),
            message_end_time=max(map(max, times)),
            uncompressed_crc=zlib.crc32(content),
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


class BagWriter:
    """Writes a bag of one file into an empty directory; not to be shared among threads.

    Messages reach the file in chunks of 768 KiB, each with a checksum, and at `flush`. `close`
    writes metadata.yaml. A directory without it holds the bag of a killed run, which lacks only its
    last chunk.

    A method that raises OSError loses nothing: the data is kept, and `flush` tries again.

    Parameters
    ----------
    directory
        Where to write; its file is named after it, as in rosbag2.
    metadata
        The run's own metadata, stored in the file and in `custom_data` of metadata.yaml.

    Raises
    ------
    UserError
        The file exists or cannot be made.
    """

    def __init__(self, directory: Path, *, metadata: Mapping[str, str] | None = None) -> None:
        self.directory = directory
        self.file = directory / f'{directory.absolute().name}_0.mcap'
        self.closed = False
        self._metadata: dict[str, str] = {}

        # What the bag has: messages that a chunk in progress still collects are not counted.
        self._span = Span()
        self._counts: Counter[int] = Counter()  # number of messages in chunks, by channel
        self._committed: Counter[int] = Counter()  # number of messages in the file, by channel
        self._committed_size = 0  # [B] of the file
        #: Three numbers in turn: the end of a chunk [B], a channel, its number of messages there.
        self._ledger = array('Q')

        # What the file describes, with the ID of each.
        self._topics: dict[int, Topic] = {}  # by the ID of their channel
        self._channels: dict[int, int] = {}  # by the identity of those topics
        self._schemas: dict[tuple[str, str | None, str], int] = {}

        self._chunk = ChunkBuilder()
        self._summary: defaultdict[int, list[bytes]] = defaultdict(list)  # records by opcode
        self._checksum = 0  # of all data in the file

        appender = None
        try:
            appender = AtomicAppender(self.file)
            self._appender = appender
            self._put(MAGIC)
            self._put(to_bytes(Header(profile='ros2', library='barc_sim')))
            self.add_metadata(metadata or {})
        except OSError as error:
            if appender:
                appender.close()
            raise UserError(
                f'the bag {str(self.file)!r} cannot be made ({error.strerror}): name another folder'
            ) from error

    @property
    def in_place(self) -> bool:
        """Whether the file is still where it was made."""
        return self._appender.in_place

    @property
    def is_whole(self) -> bool:
        """Whether the file has the size that was written."""
        return self._appender.is_whole

    @property
    def on_disk(self) -> dict[str, int]:
        """The number of messages in the file, if it is still where it was made, by topic.

        In a file that another process has truncated, those of the chunks that are left.
        """
        if not self.in_place:
            return {}
        size = self._appender.size_on_disk
        if size >= self._committed_size:
            return self._by_name(self._committed)

        remaining: Counter[int] = Counter()
        ledger = self._ledger.tolist()
        for end, channel, count in zip(ledger[::3], ledger[1::3], ledger[2::3], strict=True):
            if end <= size:
                remaining[channel] += count
        return self._by_name(remaining)

    @property
    def counts(self) -> dict[str, int]:
        """The number of messages in finished chunks, by topic."""
        return self._by_name(self._counts)

    def _by_name(self, counts: Mapping[int, int]) -> dict[str, int]:
        """Return the numbers of messages by topic, given by channel."""
        by_name: Counter[str] = Counter()
        for channel, count in counts.items():
            by_name[self._topics[channel].name] += count
        return dict(by_name)

    def add_metadata(self, entries: Mapping[str, str]) -> None:
        """Add metadata of the run; an entry replaces one of the same name."""
        self._metadata.update(entries)
        if entries:
            self._put_metadata(METADATA_NAME, entries)
        self.flush()

    def attach(self, files: Mapping[str, bytes]) -> None:
        """Attach text files, by name."""
        self._end_chunk()
        for name, data in files.items():
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
        self.flush()

    def write(self, messages: Iterable[MessageFields]) -> None:
        """Append messages.

        MCAP has no times before 1970, which another machine's clock may show: they become zero.
        """
        for topic, data, received, published, number in messages:
            channel = self._channels.get(id(topic)) or self._channel_of(topic)
            if received < 0 or published < 0:
                received = max(received, 0)  # noqa: PLW2901
                published = max(published, 0)  # noqa: PLW2901
            self._chunk.add(channel, data, number & 0xFFFF_FFFF, received, published)
            if self._chunk.size > CHUNK_SIZE:
                self._end_chunk()
        self._commit()

    def flush(self) -> None:
        """Hand all data to the operating system: then a killed process loses nothing."""
        self._end_chunk()
        self._commit()

    def close(self) -> None:
        """Finish the bag and write metadata.yaml; a second call does nothing."""
        if self.closed:
            return
        try:
            self._end_chunk()
            topics = [(topic, self._counts[channel]) for channel, topic in self._topics.items()]
            about = information(self.file.name, self._span, topics, self._metadata)
            self._put_metadata('rosbag2', {'serialized_metadata': to_yaml(about)})

            self._put(to_bytes(DataEnd(self._checksum)))
            self._put_summary()
            self._commit()
            write_metadata(self.directory, about)
        finally:
            self.closed = True
            self._appender.close()

    def _put(self, data: bytes) -> None:
        """Add data to the file's next block."""
        self._checksum = zlib.crc32(data, self._checksum)
        self._appender.write(data)

    def _add_to_summary(self, record: McapRecord) -> None:
        data = to_bytes(record)
        opcode = data[0]
        self._summary[opcode].append(data)

    def _put_metadata(self, name: str, entries: Mapping[str, str]) -> None:
        self._end_chunk()
        data = to_bytes(Metadata(name=name, metadata=dict(entries)))
        index = MetadataIndex(offset=self._appender.position, length=len(data), name=name)
        self._add_to_summary(index)
        self._put(data)

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

    def _end_chunk(self) -> None:
        """End the chunk in progress, so that it can be committed."""
        counts = {channel: len(pairs) // 2 for channel, pairs in self._chunk.pairs.items()}
        if not counts:
            return

        data, index = self._chunk.build(self._appender.position)
        self._chunk = ChunkBuilder()
        self._put(data)
        self._add_to_summary(index)

        self._span += Span(index.message_start_time, index.message_end_time, sum(counts.values()))
        self._counts.update(counts)
        end = index.chunk_start_offset + index.chunk_length
        for channel, count in counts.items():
            self._ledger.extend((end, channel, count))

    def _commit(self) -> None:
        """Write the finished chunks."""
        if self._appender.waiting:
            self._appender.commit()
            self._committed = self._counts.copy()  # a new object, as other threads read it
            self._committed_size = self._appender.position

    def _put_summary(self) -> None:
        """Write the summary, grouped by kind of record, and the offset of each group."""
        listed = Counter({opcode: len(records) for opcode, records in self._summary.items()})
        self._add_to_summary(
            Statistics(
                attachment_count=listed[Opcode.ATTACHMENT_INDEX],
                channel_count=listed[Opcode.CHANNEL],
                channel_message_counts={channel: self._counts[channel] for channel in self._topics},
                chunk_count=listed[Opcode.CHUNK_INDEX],
                message_count=self._span.count,
                metadata_count=listed[Opcode.METADATA_INDEX],
                message_start_time=self._span.start or 0,
                message_end_time=self._span.end,
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
        before_checksum = to_bytes(footer)[:-4]
        footer.summary_crc = zlib.crc32(summary + offsets + before_checksum)
        self._put(summary + offsets + to_bytes(footer) + MAGIC)
