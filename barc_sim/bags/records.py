"""Reads the records of a bag's files, up to the last whole one.

The records are those of https://mcap.dev/spec, and mcap parses them; what a file claims of itself
decides neither how much is read nor how much is unpacked.
"""

from __future__ import annotations

import logging
import os
import re
import zlib
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from struct import Struct
from typing import TYPE_CHECKING, Any

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Message, Metadata, Schema, Statistics

from barc_sim.bags.bounds import (
    MAX_ATTACHED,
    MAX_METADATA,
    MAX_QOS,
    MAX_RECORD,
    MAX_TOPICS,
    Budget,
    check_topics,
    from_yaml,
    refuse,
)
from barc_sim.bags.file import CHUNK_SIZE, MAGIC
from barc_sim.bags.recording import Topic
from barc_sim.cli.files import open_regular
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from typing import BinaryIO

    from mcap.records import McapRecord

_HEADER = Struct('<BQ')  # of a record: opcode, length
_MESSAGE = Struct('<HIQQ')  # channel, sequence number, times of reception and publication
_FOOTER = Struct('<BQQQI')  # with its header: start of the summary, of its offsets, checksum
_OPCODES = frozenset(Opcode)
_OF_MESSAGES = {Opcode.CHUNK, Opcode.MESSAGE, Opcode.MESSAGE_INDEX}
_IN_CHUNKS = {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE}
_PARSED: dict[int, Any] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK: Chunk,
    Opcode.ATTACHMENT: Attachment,
    Opcode.METADATA: Metadata,
    Opcode.STATISTICS: Statistics,
}
_logger = logging.getLogger(__name__)


@dataclass
class Damage:
    """The damage found in a file."""

    unreadable_chunks: int = 0
    unfinished: bool = False  #: its end is missing
    unread: int = 0  #: [B] after the last whole record
    cut: bool = False  #: these are at most the beginning of a record, as a kill leaves it

    def __bool__(self) -> bool:
        """Return whether anything is missing."""
        return self.unfinished or self.unreadable_chunks > 0


class Channels(dict[int, Topic]):
    """The topics of a file, by the ID of their channel."""

    def __init__(self, file: Path) -> None:
        """Begin with none; `file` is named in errors."""
        self._file = file
        self._schemas: dict[int, Schema] = {}
        self._definitions = 0  # bytes

    def add(self, record: McapRecord) -> None:
        """Add a schema or a channel; other records are ignored."""
        if isinstance(record, Schema):
            self._schemas[record.id] = record
            self._definitions += len(record.data)
            check_topics(self._file, len(self._schemas), self._definitions)
        elif isinstance(record, Channel) and (schema := self._schemas.get(record.schema_id)):
            self[record.id] = Topic(
                name=record.topic,
                type=schema.name,
                definition=schema.data.decode(errors='replace'),
                type_hash=record.metadata.get('topic_type_hash', ''),
                offered_qos=_offered_qos(record.metadata.get('offered_qos_profiles', '')),
            )
            check_topics(self._file, len(self))


@lru_cache(maxsize=16)
def _offered_qos(text: str) -> list[dict[str, Any]]:
    qos: Any = None
    with suppress(ValueError):
        qos = from_yaml(text) if len(text) <= MAX_QOS else None
    return [each for each in qos if isinstance(each, dict)] if isinstance(qos, list) else []


def files(path: Path) -> list[Path]:
    """Return the MCAP files of a bag; `path` is its directory, or one of the files."""
    if not path.exists():
        raise UserError(f'there is no bag {str(path)!r}: name the directory of a bag')
    if not path.is_dir():
        return [path.resolve() if path.is_symlink() else path]
    found = [file for file in path.glob('*.mcap') if not file.name.startswith('.')]
    if not found:
        raise UserError(f'{str(path)!r} has no .mcap file in it: name the directory of a bag')

    def order(file: Path) -> tuple[int, str]:  # run_10.mcap after run_9.mcap
        number = re.search(r'_(\d+)\.mcap$', file.name)
        return int(number[1]) if number else -1, file.name

    return sorted(found, key=order)


def budget_of(found: list[Path], *, timed: bool = True) -> Budget:
    """Return the budget for reading these files."""
    for file in found:
        _opened(file).close()
    return Budget(found, timed=timed)


def _opened(file: Path) -> BinaryIO:
    try:
        return open_regular(file, follow=False)
    except OSError as error:
        raise UserError(
            f'{str(file)!r} cannot be read ({error.strerror}): name another bag'
        ) from error


def records(
    file: Path,
    budget: Budget | None = None,
    *,
    messages: bool = True,
    damage: Damage | None = None,
) -> Iterator[McapRecord]:
    """Yield a file's records up to the last whole one, without the chunks that are damaged.

    These are the schemas, channels, messages, attachments and metadata; without `messages` the
    chunks are skipped. `budget` is that of the reading of a bag, else of this file. The damage is
    put into `damage`, else into the log as a warning.
    """
    found = Damage() if damage is None else damage
    with _opened(file) as stream:
        budget = budget or Budget([file])
        size = os.fstat(stream.fileno()).st_size
        if (magic := stream.read(len(MAGIC))) != MAGIC:
            what = 'not an MCAP file' if magic else 'empty'
            raise UserError(f'{str(file)!r} is {what}: name another bag')
        if messages:
            yield from _described(stream, size, budget)
        stream.seek(len(MAGIC))
        whole = len(MAGIC)
        try:
            for opcode, body, end in _raw(stream, size, budget, messages=messages):
                record = _parsed(opcode, body)
                whole = end
                if isinstance(record, Chunk):
                    yield from _whole(record, found, budget)
                elif record:
                    yield record
        except UserError:
            raise
        except Exception:  # noqa: BLE001 (damage may raise anything)
            found.unfinished = True
            found.unread = size - whole
            stream.seek(whole)
            found.cut = _is_cut(stream.read(_HEADER.size), found.unread)
    if damage is None and messages and found:
        _logger.warning('%s is unfinished or damaged: read up to the last whole record', file)


def _is_cut(header: bytes, size: int) -> bool:
    """Return whether `size` bytes with this header can be the beginning of a record."""
    if len(header) < _HEADER.size:
        return True
    opcode, length = _HEADER.unpack(header)
    # The longest is a chunk whose messages cannot be compressed.
    return opcode in _OPCODES and size - len(header) < length < 2 * CHUNK_SIZE


def _raw(
    stream: BinaryIO, size: int, budget: Budget, *, messages: bool = True
) -> Iterator[tuple[int, bytes, int]]:
    """Yield opcode, body and end of each record, from where the stream is up to the footer."""
    at = stream.tell()
    checksum = zlib.crc32(MAGIC)  # of the data, where they are read from their beginning
    opcode = 0
    while opcode != Opcode.FOOTER:
        header = stream.read(_HEADER.size)
        opcode, length = _HEADER.unpack(header)
        at += _HEADER.size + length
        if not opcode or at > size or (length > MAX_RECORD and opcode != Opcode.ATTACHMENT):
            raise ValueError('record')
        if length > MAX_RECORD:
            refuse(budget.file, f'{length} bytes of attached files', f'{MAX_ATTACHED}')
        budget.charge(length)
        if not messages and opcode in _OF_MESSAGES:
            stream.seek(length, os.SEEK_CUR)
            continue
        body = stream.read(length)
        if opcode == Opcode.DATA_END and messages:
            known = int.from_bytes(body[:4], 'little')
            if known not in {0, checksum}:
                raise ValueError('checksum')
        checksum = zlib.crc32(body, zlib.crc32(header, checksum))
        yield opcode, body, at
    if stream.read(len(MAGIC)) != MAGIC:
        raise ValueError('end')


def _parsed(opcode: int, body: bytes) -> McapRecord | None:
    """Return a record; None for one of a kind that is of no use here."""
    if opcode == Opcode.MESSAGE:
        channel, sequence, received, published = _MESSAGE.unpack_from(body)
        return Message(channel, received, body[_MESSAGE.size :], published, sequence)
    if opcode not in _PARSED:
        return None
    if opcode == Opcode.METADATA and len(body) > MAX_METADATA:
        return None  # it would take several times its size
    record: McapRecord = _PARSED[opcode].read(ReadDataStream(BytesIO(body)))
    return record


def _described(stream: BinaryIO, size: int, budget: Budget) -> list[McapRecord]:
    """Return the schemas and channels of the summary, as a damaged chunk may hold the others."""
    found: list[McapRecord] = []
    try:
        stream.seek(-_FOOTER.size - len(MAGIC), os.SEEK_END)
        opcode, _, start, _, _ = _FOOTER.unpack(stream.read(_FOOTER.size))
        if opcode != Opcode.FOOTER or not start:
            return []
        stream.seek(start)
        for kind, body, _ in _raw(stream, size, budget):
            if kind in {Opcode.SCHEMA, Opcode.CHANNEL} and (record := _parsed(kind, body)):
                found.append(record)
            if len(found) > 2 * MAX_TOPICS:
                return []
    except UserError:
        raise
    except Exception:  # noqa: BLE001 (damage may raise anything)
        return []
    return found


def _whole(chunk: Chunk, damage: Damage, budget: Budget) -> Iterator[McapRecord]:
    """Yield the records of a chunk, up to its damage."""
    try:
        yield from _in_chunk(_unpacked(chunk, budget), budget)
    except UserError:
        raise
    except Exception:  # noqa: BLE001 (damage may raise anything)
        damage.unreadable_chunks += 1


def _in_chunk(data: bytes, budget: Budget) -> Iterator[McapRecord]:
    at = 0
    while at < len(data):
        opcode, length = _HEADER.unpack_from(data, at)
        at += _HEADER.size + length
        if at > len(data):
            raise ValueError('record')
        budget.charge(length if opcode != Opcode.MESSAGE else 0)
        if opcode in _IN_CHUNKS and (record := _parsed(opcode, data[at - length : at])):
            yield record


def _unpacked(chunk: Chunk, budget: Budget) -> bytes:
    """Return what is in a chunk: no more than it claims, which is charged before."""
    size = chunk.uncompressed_size if chunk.compression else len(chunk.data)
    budget.charge(min(size, MAX_RECORD))
    if size > MAX_RECORD:
        raise ValueError('size')
    if chunk.compression == 'zstd':
        # The size in the frame's own header decides how much is allocated.
        if zstandard.frame_content_size(chunk.data) > size:
            raise ValueError('size')
        data = zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=size)
    elif chunk.compression == 'lz4':
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, size)
    elif chunk.compression:
        raise ValueError(f'unknown compression {chunk.compression!r}')
    else:
        data = chunk.data
    if len(data) != size or chunk.uncompressed_crc not in {0, zlib.crc32(data)}:
        raise ValueError('size or checksum')
    return data
