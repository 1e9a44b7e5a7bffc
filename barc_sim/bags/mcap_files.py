"""Reads one MCAP file of a bag, whole or damaged.

A file is read up to its last whole record. mcap parses the records. The sizes that a file claims
decide neither how much is read nor how much is unpacked.
"""

from __future__ import annotations

import os
import sys
import zlib
from contextlib import contextmanager, suppress
from io import BytesIO
from itertools import islice
from struct import Struct
from typing import TYPE_CHECKING, Any

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Schema, Statistics

from barc_sim.bags import bounds
from barc_sim.bags.bag_files import Damage, is_compressed, open_storage
from barc_sim.bags.bounds import MAX_RECORD, Budget
from barc_sim.bags.mcap_summary import HEADER, ChunkTable, read_summary, split
from barc_sim.bags.mcap_writer import MAGIC
from barc_sim.bags.messages import BagMessage
from barc_sim.bags.metadata import METADATA_NAME, Span
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator
    from pathlib import Path
    from typing import BinaryIO

    from barc_sim.bags.bag_files import FilledContents
    from barc_sim.bags.messages import Topic


_MESSAGE = Struct('<HIQQ')  # channel, sequence number, times of reception and publication
_TIMES = Struct('<QQ')  # begins a chunk: its first and last time of reception
_CHANNEL = Struct('<H')  # begins an index of a chunk's messages of a channel
_OF_MESSAGES = {Opcode.CHUNK, Opcode.MESSAGE, Opcode.MESSAGE_INDEX}
_DESCRIBING: dict[int, Any] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.ATTACHMENT: Attachment,
    Opcode.METADATA: Metadata,
    Opcode.STATISTICS: Statistics,
}
#: Begins a message that rosbag2 has compressed by zstd; CDR begins with a zero.
PACKED_MESSAGE = b'\x28\xb5\x2f\xfd'
_IN_CHUNKS = {Opcode.SCHEMA, Opcode.CHANNEL}


class McapFile:
    """A file of a bag: adds its topics and metadata to the bag, and yields its messages.

    All but the messages is read at once.

    Parameters
    ----------
    path
        The file.
    bag
        The contents of the bag, to which the file adds.
    budget
        Limits the reading of all files of the bag.
    is_alone
        Whether the bag has no other file.

    Raises
    ------
    UserError
        It cannot be read, it exceeds a bound, or it `is_alone` and not an MCAP file.
    """

    def __init__(self, path: Path, bag: FilledContents, budget: Budget, *, is_alone: bool) -> None:
        self.path = path
        self._is_alone = is_alone
        self.damage = Damage()  #: `messages` adds the damage of chunks
        self._bag = bag
        self._budget = budget
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Topic] = {}
        self._whole = 0  # the end of the last whole record
        self._chunks = ChunkTable()
        self._has_loose_messages = False  # in no chunk
        self._has_checksum = False  # of all its data
        self._forget_summary()
        if not self._describe_by_summary():
            self._forget_summary()
            self._describe_by_records()

    def _forget_summary(self) -> None:
        self.has_summary = False
        self.span = Span()
        #: The names of the files that are attached to it.
        self.attachment_names: list[str] = []
        self._statistics: Statistics | None = None
        self._channel_count: int | None = None  # of the whole file; None: unknown

    def _describe_by_summary(self) -> bool:
        """Add to the bag what the summary describes; return False if there is no whole one."""
        if is_compressed(self.path):
            return False
        opened = open_storage(self.path)
        with opened.stream as stream:
            try:
                self._check_magic(stream)
                summary = read_summary(stream, opened.size, self._budget)
                for opcode, body in summary.records:
                    self._add(opcode, body)
            except UserError:
                raise
            except Exception:  # noqa: BLE001 (damage may raise anything)
                return False

        self._chunks = summary.chunks
        self._has_checksum = summary.has_checksum
        return True

    def _describe_by_records(self) -> None:
        """Add to the bag what all records describe, up to the file's damage."""
        with self._records(messages=False) as records:
            for opcode, body in records:
                self._has_checksum |= opcode == Opcode.DATA_END and any(body[:4])
                self._add(opcode, body)

    def messages(self, start: int | None = None) -> Iterator[BagMessage]:
        """Yield the messages in the order of the file.

        Parameters
        ----------
        start
            The time [ns] from which on messages are read; None: all are.
        """
        offset = self._offset_from(start)
        with self._records(messages=True, offset=offset) as records:
            for message in self._messages_of(records):
                if start is None or message.received >= start:
                    yield message
        if offset is None:
            self._channel_count = len(self._channels)

    def _offset_from(self, start: int | None) -> int | None:
        """Return where the chunks begin that can have messages from `start` on; None: unknown."""
        has_all_channels = self._channel_count in range(len(self._channels) + 1)
        if start is None or self._has_loose_messages or not has_all_channels:
            return None

        return self._chunks.offset_from(start)

    def blocks_before(
        self, end: int, wants: Callable[[Collection[int], int], bool]
    ) -> Iterator[Iterator[BagMessage]]:
        """Yield the messages of each chunk that begins before a time, the last chunk first.

        Parameters
        ----------
        end
            The time [ns]; a chunk can have later messages, too.
        wants
            Called with the identities of the topics that a chunk can have, and its last time
            [ns]; it returns whether to read the chunk. A file without chunks, or one that has to
            be unpacked from its beginning, is one block.
        """
        if self._has_loose_messages or is_compressed(self.path):
            if wants({id(topic) for topic in self._channels.values()}, end):
                yield self.messages()
            return

        for number in reversed(range(len(self._chunks))):
            begins_before = self._chunks.starts[number] < end
            if begins_before and wants(self._topics_in(number), self._chunks.ends[number]):
                yield self._messages_at(self._chunks.offsets[number])

    def _topics_in(self, number: int) -> set[int]:
        """Return the identities of the topics in a chunk, or of all if it has no indices."""
        channels = self._chunks.channels[number]
        if not channels <= self._channels.keys():  # an unknown channel
            channels = frozenset()
        return {id(self._channels[channel]) for channel in channels or self._channels}

    def _messages_at(self, offset: int) -> Iterator[BagMessage]:
        """Yield the messages of the chunk at an offset [B]."""
        with self._records(messages=True, offset=offset) as records:
            yield from self._messages_of(islice(records, 1))

    def _messages_of(self, records: Iterator[tuple[int, bytes]]) -> Iterator[BagMessage]:
        for opcode, body in records:
            if opcode == Opcode.CHUNK:
                yield from self._in_chunk(Chunk.read(ReadDataStream(BytesIO(body))))
            elif opcode == Opcode.MESSAGE:
                message = self._message(body)
                if message is not None:
                    yield message

    @property
    def counted(self) -> list[tuple[Topic, int]]:
        """The topics with the number of messages that the summary states."""
        counts = self._statistics.channel_message_counts if self._statistics else {}
        return [(topic, counts.get(channel, 0)) for channel, topic in self._channels.items()]

    def is_whole(self) -> bool:
        """Read the file, and return whether it is undamaged, with an index and plain messages.

        The checksum of its data is compared; only a file without one is unpacked.
        """
        is_complete = (
            not self.damage
            and not is_compressed(self.path)
            and not self._has_loose_messages
            and self._statistics is not None
            and self._statistics.chunk_count == len(self._chunks)
            and self._statistics.message_count == sum(count for _, count in self.counted)
        )
        if not is_complete:
            return False

        first = next(self.messages(), None)
        if first is not None and first.data.startswith(PACKED_MESSAGE):
            return False
        with self._records(messages=True) as records:
            for opcode, body in records:
                if opcode == Opcode.MESSAGE:
                    return False
                if opcode == Opcode.CHUNK and not self._has_checksum:
                    self._unpacked(Chunk.read(ReadDataStream(BytesIO(body))))
        return not self.damage

    @contextmanager
    def _records(
        self, *, messages: bool, offset: int | None = None
    ) -> Iterator[Iterator[tuple[int, bytes]]]:
        """Open the file and provide its records; an exception while reading them is damage.

        `offset` is where the first record begins; None: after the file's first bytes.
        """
        damage = Damage()
        self.damage = damage
        opened = open_storage(self.path)
        with opened.stream as stream:
            # The size of what a compressed file contains is unknown before it is read.
            size = sys.maxsize if is_compressed(self.path) else opened.size
            self._whole = 0
            try:
                if offset is not None:
                    stream.seek(offset)
                    self._whole = offset
                yield self._raw(stream, size, messages=messages, has_beginning=offset is None)
            except UserError:
                raise
            except Exception:  # noqa: BLE001 (damage may raise anything)
                damage.unfinished = True
                damage.unread = 0 if is_compressed(self.path) else size - self._whole

    def _check_magic(self, stream: BinaryIO) -> None:
        """Read the first bytes; an exception: they are not those of MCAP.

        The recorder of a bag of several files may have been killed as it began one.
        """
        magic = b''
        with suppress(zstandard.ZstdError):
            magic = stream.read(len(MAGIC))
        if magic != MAGIC and self._is_alone:
            what = 'not an MCAP file' if self.path.lstat().st_size else 'empty'
            raise UserError(f'{str(self.path)!r} is {what}: name another bag')
        if magic != MAGIC:
            raise ValueError('magic')
        self._whole = len(MAGIC)

    def _raw(
        self, stream: BinaryIO, size: int, *, messages: bool, has_beginning: bool
    ) -> Iterator[tuple[int, bytes]]:
        """Yield opcode and body of each record up to the footer, with or without `messages`.

        The checksum of all data is compared only where it is read `has_beginning` and messages.
        """
        if has_beginning:
            self._check_magic(stream)
        end = self._whole
        checksum = zlib.crc32(MAGIC)  # of all data before the summary
        opcode = 0
        while opcode != Opcode.FOOTER:
            header = stream.read(HEADER.size)
            opcode, length = HEADER.unpack(header)
            end += HEADER.size + length
            max_length = self._budget.max_chunk if opcode in _OF_MESSAGES else MAX_RECORD
            if not opcode or end > size or length > max_length:
                raise ValueError('record')
            self._budget.charge(length)

            if not messages and opcode in _OF_MESSAGES:
                self._pass_over(stream, opcode, length)
            else:
                body = stream.read(length)
                if len(body) < length:
                    raise ValueError('end')
                # Zero in place of a checksum: the writer has computed none.
                expected = int.from_bytes(body[:4], 'little')
                is_checked = messages and has_beginning and opcode == Opcode.DATA_END
                if is_checked and expected not in {0, checksum}:
                    raise ValueError('checksum')
                checksum = zlib.crc32(header, checksum)
                checksum = zlib.crc32(body, checksum)
                yield opcode, body
            self._whole = end

        if stream.read(len(MAGIC)) != MAGIC:
            raise ValueError('end')

    def _pass_over(self, stream: BinaryIO, opcode: int, length: int) -> None:
        """Pass over a record's body of `length` bytes; note places and channels of chunks."""
        if opcode == Opcode.CHUNK and length >= _TIMES.size:
            offset = stream.tell() - HEADER.size
            start, end = _TIMES.unpack(stream.read(_TIMES.size))
            self._chunks.add(offset, start, end)
            length -= _TIMES.size
        elif opcode == Opcode.MESSAGE_INDEX and length >= _CHANNEL.size:
            (channel,) = _CHANNEL.unpack(stream.read(_CHANNEL.size))
            self._chunks.add_channel(channel)
            length -= _CHANNEL.size
        self._has_loose_messages |= opcode == Opcode.MESSAGE
        stream.seek(length, os.SEEK_CUR)

    def _add(self, opcode: int, body: bytes) -> None:
        """Add a topic, metadata, an attached file or a time span to the bag; skip other records."""
        if opcode not in _DESCRIBING:
            return
        if opcode == Opcode.METADATA and len(body) > bounds.MAX_METADATA:
            return  # in memory, metadata takes several times its size

        record: Any = _DESCRIBING[opcode].read(ReadDataStream(BytesIO(body)))
        if isinstance(record, Schema):
            self._budget.keep(body)
            self._schemas[record.id] = record
        elif isinstance(record, Channel):
            self._budget.keep(body)
            schema = self._schemas.get(record.schema_id)
            self._channels[record.id] = self._bag.topic(record, schema)
        elif isinstance(record, Metadata) and record.name == METADATA_NAME:
            self._budget.keep(body)
            _check_texts(self.path, record.metadata)
            self._bag.metadata.update(record.metadata)
        elif isinstance(record, Attachment):
            self._budget.keep(body)
            self._bag.attachments[record.name] = record.data
            self.attachment_names.append(record.name)
        elif isinstance(record, Statistics):
            self.has_summary = True
            self._statistics = record
            self._channel_count = record.channel_count
            if record.message_count:
                self.span = Span(
                    record.message_start_time, record.message_end_time, record.message_count
                )

    def _in_chunk(self, chunk: Chunk) -> Iterator[BagMessage]:
        """Yield the messages of a chunk, up to its damage."""
        try:
            for opcode, body in split(self._unpacked(chunk)):
                if opcode == Opcode.MESSAGE:
                    self._budget.charge()  # its bytes are charged with the chunk's
                    message = self._message(body)
                    if message is not None:
                        yield message
                else:
                    self._budget.charge(len(body))
                    if opcode in _IN_CHUNKS:
                        self._add(opcode, body)
        except UserError:
            raise
        except Exception:  # noqa: BLE001 (damage may raise anything)
            self.damage.unreadable_chunks += 1

    def _message(self, body: bytes) -> BagMessage | None:
        """Return the message of a record; None if its channel is unknown."""
        channel, number, received, published = _MESSAGE.unpack_from(body)
        topic = self._channels.get(channel)
        if topic is None:
            return None
        return BagMessage(topic, body[_MESSAGE.size :], received, published, number)

    def _unpacked(self, chunk: Chunk) -> bytes:
        """Return a chunk's unpacked records: at most its claimed size, which is charged before."""
        size = chunk.uncompressed_size if chunk.compression else len(chunk.data)
        self._budget.charge(min(size, self._budget.max_chunk))
        if size > self._budget.max_chunk:
            raise ValueError('size')

        if chunk.compression == 'zstd':
            data = unpacked(chunk.data, size)
        elif chunk.compression == 'lz4':
            data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, size)
        elif chunk.compression:
            raise ValueError(f'unknown compression {chunk.compression!r}')
        else:
            data = chunk.data

        if len(data) != size or chunk.uncompressed_crc not in {0, zlib.crc32(data)}:
            raise ValueError('size or checksum')
        return data


def _check_texts(path: Path, metadata: dict[str, str]) -> None:
    """Refuse metadata with longer texts than a run has."""
    for name, text in metadata.items():
        if len(text) > bounds.MAX_TEXT:
            excess = f'{len(text)} characters of metadata {name[:40]!r}'
            bounds.refuse(path, excess, f'{bounds.MAX_TEXT}')


def unpacked(data: bytes, max_size: int) -> bytes:
    """Decompress data of zstd; an exception: it is damaged, or larger than `max_size` [B]."""
    # The size in the frame's own header decides how much is allocated.
    if zstandard.frame_content_size(data) > max_size:
        raise ValueError('size')
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=max_size)
