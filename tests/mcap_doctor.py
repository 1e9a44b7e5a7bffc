"""Checks a file against the MCAP specification, as `mcap doctor` does."""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING

from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.stream_reader import StreamReader, breakup_chunk

if TYPE_CHECKING:
    from pathlib import Path


class _Located:
    """The records of a file, with where each begins and how long it is."""

    def __init__(self, file: Path) -> None:
        self.content = file.read_bytes()
        self.records: list[tuple[int, int, McapRecord]] = []
        with file.open('rb') as stream:
            start = 8
            for record in StreamReader(stream, emit_chunks=True, validate_crcs=True).records:
                length = int.from_bytes(self.content[start + 1 : start + 9], 'little') + 9
                self.records.append((start, length, record))
                start += length


def check(file: Path) -> None:
    """Raise AssertionError where the file is not as the specification wants it."""
    located = _Located(file)
    records = [record for _, _, record in located.records]
    (end,) = (n for n, record in enumerate(records) if isinstance(record, DataEnd))
    data, summary = located.records[:end], located.records[end + 1 : -1]
    assert isinstance(records[0], Header)
    assert (records[0].profile, bool(records[0].library)) == ('ros2', True)
    assert isinstance(records[-1], Footer)
    assert located.content[-8:] == located.content[:8]
    assert records[end].data_section_crc == zlib.crc32(located.content[: located.records[end][0]])  # type: ignore[attr-defined]
    assert records[-1].summary_start == (summary[0][0] if summary else 0)
    until_crc = located.records[-1][0] + 9 + 16
    summary_crc = zlib.crc32(located.content[records[-1].summary_start : until_crc])
    assert records[-1].summary_crc == summary_crc
    messages = _check_data(data)
    _check_summary(located.content, data, summary, messages)
    offsets = [record for _, _, record in summary if isinstance(record, SummaryOffset)]
    ends = [offset.group_start + offset.group_length for offset in offsets]
    starts = [offset.group_start for offset in offsets] + [records[-1].summary_offset_start]
    assert starts == [records[-1].summary_start, *ends]


def _check_data(data: list[tuple[int, int, McapRecord]]) -> list[Message]:
    """Check the chunks and their message indexes; return the messages."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    found: list[Message] = []
    allowed = (Header, Attachment, Chunk, MessageIndex, Metadata)
    assert all(isinstance(record, allowed) for _, _, record in data)
    for number, (_, _, chunk) in enumerate(data):
        if not isinstance(chunk, Chunk):
            continue
        messages: list[Message] = []
        for record in breakup_chunk(chunk, validate_crc=True):
            if isinstance(record, Schema):
                assert record.id > 0
                assert record.encoding
                assert record.data
                assert schemas.setdefault(record.id, record) == record
            elif isinstance(record, Channel):
                assert record.schema_id in schemas
                assert channels.setdefault(record.id, record) == record
            elif isinstance(record, Message):
                assert record.channel_id in channels
                messages.append(record)
        assert messages
        assert chunk.uncompressed_crc
        assert chunk.message_start_time == min(message.log_time for message in messages)
        assert chunk.message_end_time == max(message.log_time for message in messages)
        indexed: dict[int, int] = {}
        for _, _, record in data[number + 1 :]:
            if not isinstance(record, MessageIndex):
                break
            indexed[record.channel_id] = len(record.records)
        counted: dict[int, int] = {}
        for message in messages:
            counted[message.channel_id] = counted.get(message.channel_id, 0) + 1
        assert indexed == counted
        found.extend(messages)
    return found


def _check_summary(
    content: bytes,
    data: list[tuple[int, int, McapRecord]],
    summary: list[tuple[int, int, McapRecord]],
    messages: list[Message],
) -> None:
    records = [record for _, _, record in summary]
    at = {start: (length, record) for start, length, record in data}
    channels = {record.id: record for record in records if isinstance(record, Channel)}
    schemas = {record.id for record in records if isinstance(record, Schema)}
    assert {message.channel_id for message in messages} == set(channels)
    assert {channel.schema_id for channel in channels.values()} == schemas
    indexes = [record for record in records if isinstance(record, ChunkIndex)]
    chunks = [start for start, (_, record) in at.items() if isinstance(record, Chunk)]
    assert [index.chunk_start_offset for index in indexes] == chunks
    for index in indexes:
        length, chunk = at[index.chunk_start_offset]
        assert isinstance(chunk, Chunk)
        assert (index.chunk_length, index.compression) == (length, chunk.compression)
        assert index.compressed_size == len(chunk.data)
        assert index.uncompressed_size == chunk.uncompressed_size
        assert index.message_start_time == chunk.message_start_time
        assert index.message_end_time == chunk.message_end_time
        for channel, offset in index.message_index_offsets.items():
            assert isinstance(at[offset][1], MessageIndex)
            assert at[offset][1].channel_id == channel  # type: ignore[attr-defined]
    for record in records:
        if isinstance(record, MetadataIndex):
            length, metadata = at[record.offset]
            assert isinstance(metadata, Metadata)
            assert (record.length, record.name) == (length, metadata.name)
        elif isinstance(record, AttachmentIndex):
            length, file = at[record.offset]
            assert isinstance(file, Attachment)
            assert (record.length, record.name) == (length, file.name)
            assert (record.media_type, record.data_size) == (file.media_type, len(file.data))
        elif isinstance(record, SummaryOffset) and record.group_length:
            assert content[record.group_start] == record.group_opcode
    (statistics,) = (record for record in records if isinstance(record, Statistics))
    times = [message.log_time for message in messages] or [0]
    assert (statistics.message_start_time, statistics.message_end_time) == (min(times), max(times))
    assert statistics.message_count == len(messages)
    assert sum(statistics.channel_message_counts.values()) == len(messages)
    assert set(statistics.channel_message_counts) == set(channels)
    assert statistics.channel_count == len(channels)
    assert statistics.schema_count == len(schemas)
    assert statistics.chunk_count == len(chunks)
    attachments = [record for _, _, record in data if isinstance(record, Attachment)]
    assert statistics.attachment_count == len(attachments)
    assert len(attachments) == sum(isinstance(record, AttachmentIndex) for record in records)
