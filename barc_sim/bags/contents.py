"""The topics and messages of any MCAP bag: rosbag2's, our own, and damaged ones.

An MCAP file is read up to its last whole record. mcap parses the records. The sizes that a file
claims decide neither how much is read nor how much is unpacked.
"""

from __future__ import annotations

import os
import re
import zlib
from collections import Counter, deque
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from heapq import heappop, heappush
from io import BytesIO
from itertools import chain
from struct import Struct
from typing import TYPE_CHECKING, Any

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Schema, Statistics
from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_idl, get_types_from_msg

from barc_sim.bags import bounds
from barc_sim.bags.bounds import MAX_RECORD, Budget
from barc_sim.bags.messages import (
    CDR,
    IDL,
    ROS2IDL,
    ROS2MSG,
    Message,
    Topic,
)
from barc_sim.bags.recording import METADATA_NAME, Span
from barc_sim.bags.schemas import schema
from barc_sim.bags.writer import MAGIC
from barc_sim.cli.files import open_regular
from barc_sim.cli.yaml_files import from_yaml
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from typing import BinaryIO


_HEADER = Struct('<BQ')  # of a record: opcode, length
_MESSAGE = Struct('<HIQQ')  # channel, sequence number, times of reception and publication
_OF_MESSAGES = {Opcode.CHUNK, Opcode.MESSAGE, Opcode.MESSAGE_INDEX}
_DESCRIBING: dict[int, Any] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.ATTACHMENT: Attachment,
    Opcode.METADATA: Metadata,
    Opcode.STATISTICS: Statistics,
}
_IN_CHUNKS = {Opcode.SCHEMA, Opcode.CHANNEL}
_CONVERTIBLE = {'.db3', '.zstd'}  #: suffixes of rosbag2's files that `rosbags-convert` reads


@dataclass
class Damage:
    """The damage found in a file."""

    unreadable_chunks: int = 0
    unfinished: bool = False  #: its end is missing
    unread: int = 0  #: [B] after the last whole record

    def __bool__(self) -> bool:
        """Return whether anything is missing."""
        return self.unfinished or self.unreadable_chunks > 0


def files(path: Path) -> list[Path]:
    """Return the MCAP files of a bag; `path` is its directory, or one of the files."""
    if not path.exists():
        raise UserError(f'there is no bag {str(path)!r}: name the directory of a bag')
    present = [*path.iterdir()] if path.is_dir() else [path]
    mcap = [file for file in present if file.suffix == '.mcap' and not file.name.startswith('.')]
    if not mcap and any(file.suffix in _CONVERTIBLE for file in present):
        from barc_sim.bags.sqlite import conversion  # noqa: PLC0415 (slow: for few bags)

        raise UserError(conversion(path, present))
    if not path.is_dir():
        return [path.resolve() if path.is_symlink() else path]
    if not mcap:
        raise UserError(f'{str(path)!r} has no .mcap file in it: name the directory of a bag')

    def order(file: Path) -> tuple[int, str]:  # run_10.mcap after run_9.mcap
        number = re.search(r'_(\d+)\.mcap$', file.name)
        return int(number[1]) if number else -1, file.name

    return sorted(mcap, key=order)


class McapFile:
    """A file of a bag: adds its topics and metadata to the bag, and yields its messages."""

    def __init__(self, path: Path, bag: Contents, budget: Budget) -> None:
        """Read all but the messages; UserError: it is not an MCAP file, or exceeds a bound."""
        self.path = path
        self.has_summary = False
        self.damage = Damage()  #: `messages` adds the damage of chunks
        self._bag = bag
        self._budget = budget
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Topic] = {}
        self._whole = 0  # the end of the last whole record
        with self._records(messages=False) as records:
            for opcode, body in records:
                self._add(opcode, body)

    def messages(self) -> Iterator[Message]:
        """Yield the messages in the order of the file."""
        with self._records(messages=True) as records:
            for opcode, body in records:
                if opcode == Opcode.CHUNK:
                    yield from self._in_chunk(Chunk.read(ReadDataStream(BytesIO(body))))
                elif opcode == Opcode.MESSAGE and (message := self._message(body)):
                    yield message

    @contextmanager
    def _records(self, *, messages: bool) -> Iterator[Iterator[tuple[int, bytes]]]:
        """Open the file and provide its records; an exception while reading them is damage."""
        self.damage = damage = Damage()
        try:
            stream = open_regular(self.path, follow=False)
        except OSError as error:
            raise UserError(
                f'{str(self.path)!r} cannot be read ({error.strerror}): name another bag'
            ) from error
        with stream:
            size = os.fstat(stream.fileno()).st_size
            if (magic := stream.read(len(MAGIC))) != MAGIC:
                what = 'not an MCAP file' if magic else 'empty'
                raise UserError(f'{str(self.path)!r} is {what}: name another bag')
            self._whole = len(MAGIC)
            try:
                yield self._raw(stream, size, messages=messages)
            except UserError:
                raise
            except Exception:  # noqa: BLE001 (damage may raise anything)
                damage.unfinished = True
                damage.unread = size - self._whole

    def _raw(self, stream: BinaryIO, size: int, *, messages: bool) -> Iterator[tuple[int, bytes]]:
        """Yield opcode and body of each record up to the footer, with or without `messages`."""
        at = self._whole
        checksum = zlib.crc32(MAGIC)  # of all data before the summary
        opcode = 0
        while opcode != Opcode.FOOTER:
            header = stream.read(_HEADER.size)
            opcode, length = _HEADER.unpack(header)
            at += _HEADER.size + length
            maximum = self._budget.max_chunk if opcode in _OF_MESSAGES else MAX_RECORD
            if not opcode or at > size or length > maximum:
                raise ValueError('record')
            self._budget.charge(length)
            if not messages and opcode in _OF_MESSAGES:
                stream.seek(length, os.SEEK_CUR)
            else:
                body = stream.read(length)
                expected = int.from_bytes(body[:4], 'little')
                if messages and opcode == Opcode.DATA_END and expected not in {0, checksum}:
                    raise ValueError('checksum')
                checksum = zlib.crc32(body, zlib.crc32(header, checksum))
                yield opcode, body
            self._whole = at
        if stream.read(len(MAGIC)) != MAGIC:
            raise ValueError('end')

    def _add(self, opcode: int, body: bytes) -> None:
        """Add a topic, metadata, an attached file or a time span to the bag; skip other records."""
        if opcode not in _DESCRIBING or (
            opcode == Opcode.METADATA and len(body) > bounds.MAX_METADATA
        ):
            return  # in memory, metadata takes several times its size
        record: Any = _DESCRIBING[opcode].read(ReadDataStream(BytesIO(body)))
        bag, keep = self._bag, self._budget.keep
        if isinstance(record, Schema):
            keep(body)
            self._schemas[record.id] = record
        elif isinstance(record, Channel):
            keep(body)
            self._channels[record.id] = bag.topic(record, self._schemas.get(record.schema_id))
        elif isinstance(record, Metadata) and record.name == METADATA_NAME:
            keep(body)
            bag.metadata |= _checked(self.path, record.metadata)
        elif isinstance(record, Attachment):
            keep(body)
            bag.attachments[record.name] = record.data
        elif isinstance(record, Statistics):
            self.has_summary = True
            if record.message_count:
                start, end = record.message_start_time, record.message_end_time
                bag.span += Span(start, end, record.message_count)

    def _in_chunk(self, chunk: Chunk) -> Iterator[Message]:
        """Yield the messages of a chunk, up to its damage."""
        try:
            for opcode, body in _split(self._unpacked(chunk)):
                self._budget.charge(0 if opcode == Opcode.MESSAGE else len(body))
                if opcode == Opcode.MESSAGE:
                    if message := self._message(body):
                        yield message
                elif opcode in _IN_CHUNKS:
                    self._add(opcode, body)
        except UserError:
            raise
        except Exception:  # noqa: BLE001 (damage may raise anything)
            self.damage.unreadable_chunks += 1

    def _message(self, body: bytes) -> Message | None:
        channel, sequence, received, published = _MESSAGE.unpack_from(body)
        if topic := self._channels.get(channel):
            return Message(topic, body[_MESSAGE.size :], received, published, sequence)
        return None

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


def _checked(path: Path, metadata: dict[str, str]) -> dict[str, str]:
    for name, text in metadata.items():
        if len(text) > bounds.MAX_TEXT:
            excess = f'{len(text)} characters of metadata {name[:40]!r}'
            bounds.refuse(path, excess, f'{bounds.MAX_TEXT}')
    return metadata


def _split(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield opcode and body of each record in a chunk."""
    at = 0
    while at < len(data):
        opcode, length = _HEADER.unpack_from(data, at)
        at += _HEADER.size + length
        if at > len(data):
            raise ValueError('record')
        yield opcode, data[at - length : at]


def unpacked(data: bytes, max_size: int) -> bytes:
    """Decompress zstd's data; an exception: it is damaged, or larger than `max_size` [B]."""
    # The size in the frame's own header decides how much is allocated.
    if zstandard.frame_content_size(data) > max_size:
        raise ValueError('size')
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=max_size)


@lru_cache(maxsize=16)
def _offered_qos(text: str) -> list[dict[str, Any]]:
    qos: Any = None
    with suppress(ValueError):
        qos = from_yaml(text) if len(text) <= bounds.MAX_QOS else None
    return [each for each in qos if isinstance(each, dict)] if isinstance(qos, list) else []


_ZSTD = b'\x28\xb5\x2f\xfd'  # begins a message that rosbag2 has compressed; CDR begins with a zero
#: [ns] by which a message may stand behind later messages in a file.
_DISORDER = 2_000_000_000
_NO_FIELDS = [('structure_needs_at_least_one_member', (Nodetype.BASE, ('uint8', 0)))]
_LOSSES = ('lost ', 'lost_messages', 'not recorded ')


class Contents:
    """The contents of a bag: topics and metadata are read at once, and messages by `messages`.

    Attributes
    ----------
    topics
        The topics, in the order of the bag; a name with messages of two types has two.
    files
        The bag's files.
    span
        The time span of all messages, or of the messages that were read.
    metadata, attachments
        The run's metadata, and the attached files by name.
    """

    def __init__(self, path: Path, *, timed: bool = False) -> None:
        """Read all but the messages of the bag at `path`: its directory, or one of its files.

        If `timed`, the time for all reading is limited.

        UserError: there is no bag, it cannot be read, or it exceeds a bound.
        """
        self.path = path
        self.topics: list[Topic] = []
        self._by_content: dict[tuple[Any, ...], Topic] = {}  # equal topics of all files are one
        self._definitions: dict[bytes, str] = {}  # equal schemas of all topics are stored once
        self._counts: Counter[int] = Counter()  # number of messages read, by identity of the topic
        self.span = Span()
        self.metadata: dict[str, str] = {}
        self.attachments: dict[str, bytes] = {}
        paths = files(path)
        self._budget = Budget(paths, timed=timed)
        self.files = [McapFile(file, self, self._budget) for file in paths]

    @property
    def damages(self) -> dict[str, Damage]:
        """The damage of each damaged file, by the file's name."""
        return {file.path.name: file.damage for file in self.files if file.damage}

    def topic(self, channel: Channel, schema: Schema | None) -> Topic:
        """Return the topic of a channel, the same one for equal channels of all files."""
        described = (schema.name, schema.encoding, schema.data) if schema else None
        metadata = tuple(channel.metadata.items())
        content = channel.topic, channel.message_encoding, described, metadata
        if content not in self._by_content:
            self._by_content[content] = self._add(channel, schema)
        return self._by_content[content]

    def _add(self, channel: Channel, schema: Schema | None) -> Topic:
        data = schema.data if schema else b''
        text = self._definitions.setdefault(data, data.decode(errors='surrogateescape'))
        topic = Topic(
            name=channel.topic,
            type=schema.name if schema else '',
            definition=text,
            type_hash=channel.metadata.get('topic_type_hash', ''),
            offered_qos=_offered_qos(channel.metadata.get('offered_qos_profiles', '')),
            schema_encoding=schema.encoding if schema else None,
            message_encoding=channel.message_encoding,
            metadata=channel.metadata,
        )
        self.topics.append(topic)
        return topic

    @property
    def names(self) -> list[str]:
        """The topics' names, each once."""
        return [*dict.fromkeys(topic.name for topic in self.topics)]

    @property
    def counted(self) -> list[tuple[Topic, int]]:
        """The topics with the number of messages that were read, by name."""
        topics = sorted(self.topics, key=lambda topic: topic.name)
        return [(topic, self._counts[id(topic)]) for topic in topics]

    def complete(self) -> None:
        """Read all messages if a file has no summary, to find the topics and the span."""
        if not all(file.has_summary for file in self.files):
            deque(self.messages(), maxlen=0)

    def messages(self) -> Iterator[Message]:
        """Yield the messages in the order of the bag, up to its damage."""
        self._counts = Counter()
        self.span = Span()
        self._budget.renew()
        for message in chain.from_iterable(file.messages() for file in self.files):
            self._counts[id(message.topic)] += 1
            self.span.add(message.received)
            if message.data.startswith(_ZSTD):
                yield message._replace(data=self._unpacked(message.data))
            else:
                yield message

    def in_order(self) -> Iterator[Message]:
        """Yield the messages in order of reception, if none is more than 2 s behind a later one."""
        waiting: list[tuple[int, int, Message]] = []
        for number, message in enumerate(self.messages()):
            heappush(waiting, (message.received, number, message))
            while waiting[0][0] < message.received - _DISORDER:
                yield heappop(waiting)[2]
        while waiting:
            yield heappop(waiting)[2]

    def _unpacked(self, data: bytes) -> bytes:
        """Return the data of a message that rosbag2 has compressed."""
        try:
            decompressed = unpacked(data, self._budget.max_chunk)
        except Exception:  # noqa: BLE001 (damage may raise anything)
            return data
        self._budget.charge(len(decompressed))
        return decompressed


def types_of(topic: Topic) -> dict[str, Any]:
    """Return the types in a topic's definition.

    ValueError: its messages or its definition have another encoding than ROS's, or the definition
    exceeds a bound. LookupError: it has no definition, and its type is not installed.
    """
    text, encoding = _definition(topic)
    if len(text) > bounds.MAX_SCHEMA:
        raise ValueError(f'its definition has {len(text)} characters')
    types: dict[str, Any] = {}
    if encoding == ROS2IDL or text.startswith(IDL):
        for part in text.split('=' * 80 + '\n')[1:]:
            types |= get_types_from_idl(part.partition('\n')[2])
    else:
        types |= get_types_from_msg(text, topic.type)
    described = [each for _, fields in types.values() for _, each in fields]
    arrays = [of for node, of in described if node == Nodetype.ARRAY]
    # rosbags writes code for each element of an array of texts or of messages.
    written = [n for (node, of), n in arrays if node == Nodetype.NAME or of[0] == 'string']
    if sum(written) > bounds.MAX_ARRAY:
        raise ValueError(f'its arrays have {sum(written)} elements')
    # A message without fields has a byte in CDR.
    return {name: (constants, fields or _NO_FIELDS) for name, (constants, fields) in types.items()}


def _definition(topic: Topic) -> tuple[str, str]:
    """Return a topic's definition, by default the installed one, and its encoding."""
    if topic.message_encoding != CDR:
        raise ValueError(f'its messages are {topic.message_encoding!r}, and not {CDR!r}')
    if not topic.type:
        raise ValueError('it has no schema')
    if topic.definition:
        if topic.schema_encoding not in (ROS2MSG, ROS2IDL):
            raise ValueError(
                f'its schema is {topic.schema_encoding!r}, and not {ROS2MSG!r} or {ROS2IDL!r}'
            )
        # Bytes that are no UTF-8 cannot be printed.
        data = topic.definition.encode(errors='surrogateescape')
        return data.decode(errors='replace'), topic.schema_encoding
    try:
        return schema(topic.type)
    except LookupError:
        if topic.schema_encoding == ROS2MSG:  # rosbag2 writes so a type without fields
            return '', ROS2MSG
        raise


def describe(path: Path) -> dict[str, Any]:
    """Read a whole bag; return a description of it in JSON's types, with times in seconds.

    UserError: there is no bag, or it cannot be read.
    """
    contents = Contents(path)
    deque(contents.messages(), maxlen=0)
    span, metadata = contents.span, contents.metadata
    losses = {k: v for k, v in metadata.items() if k.startswith(_LOSSES)}
    return {
        'path': str(path),
        'files': {file.path.name: file.path.stat().st_size for file in contents.files},
        'start': (span.start or 0) / 1e9,
        'duration': span.duration / 1e9,
        'messages': span.count,
        'topics': [
            {
                'name': topic.name,
                'type': topic.type,
                'encoding': topic.message_encoding,
                'messages': count,
            }
            for topic, count in contents.counted
        ],
        'losses': losses,
        'damages': {name: vars(damage) for name, damage in contents.damages.items()},
        'metadata': {name: text for name, text in metadata.items() if name not in losses},
    }
