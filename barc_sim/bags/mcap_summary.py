"""Reads the summary at the end of an MCAP file, so that its chunks need not be looked at."""

from __future__ import annotations

import zlib
from array import array
from collections import Counter
from dataclasses import dataclass, field
from io import BytesIO
from struct import Struct
from typing import TYPE_CHECKING, Any

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, MetadataIndex, Statistics

from barc_sim.bags.bounds import MAX_RECORD, Budget
from barc_sim.bags.mcap_writer import MAGIC

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from typing import BinaryIO

HEADER = Struct('<BQ')  #: of a record: opcode, length
_FOOTER = Struct('<QQI')  # where the summary and its offsets begin, checksum
_DATA_END = Struct('<I')  # checksum of all data
#: Begins a chunk's index: first and last time, offset and length of the chunk, length of the pairs.
_CHUNK_INDEX = Struct('<QQQQI')
_CHANNEL_INDEX = Struct('<HQ')  # a pair: channel, offset of its messages' index
_INDEXES: dict[int, Any] = {
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.METADATA_INDEX: MetadataIndex,
}


class ChunkTable:
    """The chunks of a file, in their order."""

    def __init__(self) -> None:
        self.offsets = array('Q')  #: [B]
        self.starts = array('Q')  #: [ns] first time of reception in each chunk
        self.ends = array('Q')  #: [ns] last time of reception
        #: The channels in each chunk by its indices; equal sets are stored once.
        self.channels: list[frozenset[int]] = []
        self._sets: dict[frozenset[int], frozenset[int]] = {}

    def __len__(self) -> int:
        """Return the number of chunks."""
        return len(self.offsets)

    def add(self, offset: int, start: int, end: int, channels: Iterable[int] = ()) -> None:
        """Add a chunk."""
        self.offsets.append(offset)
        self.starts.append(start)
        self.ends.append(end)
        self.channels.append(self._stored(frozenset(channels)))

    def add_channel(self, channel: int) -> None:
        """Add a channel to the last chunk."""
        if self.channels:
            self.channels[-1] = self._stored(self.channels[-1] | {channel})

    def _stored(self, channels: frozenset[int]) -> frozenset[int]:
        return self._sets.setdefault(channels, channels)

    def offset_from(self, start: int) -> int | None:
        """Return where the chunks begin that have messages from a time [ns] on; None: no chunk."""
        for offset, end in zip(self.offsets, self.ends, strict=True):
            if end >= start:
                return offset
        return self.offsets[-1] if self.offsets else None


@dataclass
class FileSummary:
    """What a file's summary describes."""

    #: Opcode and body of each record that describes the file, as in the file.
    records: list[tuple[int, bytes]] = field(default_factory=list)
    chunks: ChunkTable = field(default_factory=ChunkTable)
    has_checksum: bool = False  #: of all data


def read_summary(stream: BinaryIO, size: int, budget: Budget) -> FileSummary:
    """Read the summary of a file, and the attached files and metadata that it refers to.

    Parameters
    ----------
    stream
        The file.
    size
        Its size [B].
    budget
        Limits the reading of the bag.

    Raises
    ------
    UserError
        It exceeds a bound.
    Exception
        There is no summary, it is damaged, or it does not index all of the file.
    """
    begin = size - len(MAGIC) - _FOOTER.size - HEADER.size
    footer = _read(stream, begin, Opcode.FOOTER, budget)
    if stream.read() != MAGIC:
        raise ValueError('end')
    summary_start, _, checksum = _FOOTER.unpack(footer)
    length = begin - summary_start
    if not 0 < length <= MAX_RECORD:
        raise ValueError('summary')

    budget.charge(length)
    stream.seek(summary_start)
    content = stream.read(length)
    covered = content + HEADER.pack(Opcode.FOOTER, _FOOTER.size) + footer[: -_DATA_END.size]
    if checksum not in {0, zlib.crc32(covered)}:
        raise ValueError('checksum')

    summary = _indexed(stream, content, budget)
    data_end_start = summary_start - HEADER.size - _DATA_END.size
    data_end = _read(stream, data_end_start, Opcode.DATA_END, budget)
    summary.has_checksum = any(data_end)
    return summary


def _indexed(stream: BinaryIO, content: bytes, budget: Budget) -> FileSummary:
    """Return the summary with all that it refers to; ValueError: its index is not complete."""
    summary = FileSummary()
    counts: Counter[int] = Counter()
    chunks = []
    places = []
    statistics = None
    for opcode, body in split(content):
        budget.charge(len(body))
        counts[opcode] += 1
        if opcode == Opcode.CHUNK_INDEX:
            chunks.append(_chunk_of(body))
        elif opcode in _INDEXES:
            index = _INDEXES[opcode].read(ReadDataStream(BytesIO(body)))
            kind = Opcode.METADATA if opcode == Opcode.METADATA_INDEX else Opcode.ATTACHMENT
            places.append((index.offset, kind))
        else:
            summary.records.append((opcode, body))
        if opcode == Opcode.STATISTICS:
            statistics = Statistics.read(ReadDataStream(BytesIO(body)))

    is_complete = (
        statistics is not None
        and statistics.schema_count == counts[Opcode.SCHEMA]
        and statistics.channel_count == counts[Opcode.CHANNEL]
        and statistics.chunk_count == counts[Opcode.CHUNK_INDEX]
        and statistics.attachment_count == counts[Opcode.ATTACHMENT_INDEX]
        and statistics.metadata_count == counts[Opcode.METADATA_INDEX]
        and (statistics.chunk_count > 0 or statistics.message_count == 0)
    )
    if not is_complete:
        raise ValueError('index')

    for chunk in sorted(chunks):
        summary.chunks.add(*chunk)
    for offset, kind in sorted(places):
        summary.records.append((kind, _read(stream, offset, kind, budget)))
    return summary


def _chunk_of(body: bytes) -> tuple[int, int, int, list[int]]:
    """Return offset, first and last time, and channels of a chunk, from its index."""
    start, end, offset, _, length = _CHUNK_INDEX.unpack_from(body)
    pairs = body[_CHUNK_INDEX.size : _CHUNK_INDEX.size + length]
    channels = [channel for channel, _ in _CHANNEL_INDEX.iter_unpack(pairs)]
    return offset, start, end, channels


def _read(stream: BinaryIO, offset: int, opcode: int, budget: Budget) -> bytes:
    """Return the body of the record at a place; ValueError: it is another one."""
    stream.seek(offset)
    actual_opcode, length = HEADER.unpack(stream.read(HEADER.size))
    if actual_opcode != opcode or length > MAX_RECORD:
        raise ValueError('record')
    budget.charge(length)
    body = stream.read(length)
    if len(body) < length:
        raise ValueError('record')
    return body


def split(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield opcode and body of each record in a chunk or a summary."""
    end = 0
    while end < len(data):
        opcode, length = HEADER.unpack_from(data, end)
        start = end + HEADER.size
        end = start + length
        if end > len(data):
            raise ValueError('record')
        yield opcode, data[start:end]
