"""Checks an MCAP file by the readers of mcap, forwards and by its summary."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader

if TYPE_CHECKING:
    from pathlib import Path


def check(file: Path) -> None:
    """Assert that a file holds the same from its begin to its end and by its summary."""
    with file.open('rb') as stream:
        records = [*StreamReader(stream, validate_crcs=True).records]
    with file.open('rb') as stream:
        reader = SeekingReader(stream, validate_crcs=True)
        summary = reader.get_summary()
        messages = [message for _, _, message in reader.iter_messages(log_time_order=False)]
        further_records = [*reader.iter_metadata(), *reader.iter_attachments()]
    assert messages == [record for record in records if isinstance(record, Message)]
    for kind in (Metadata, Attachment):
        of_kind = [other for other in further_records if isinstance(other, kind)]
        assert of_kind == [record for record in records if isinstance(record, kind)]
    assert summary
    assert summary.statistics
    statistics, counts = summary.statistics, Counter(each.channel_id for each in messages)
    assert {**counts} == statistics.channel_message_counts
    assert {*counts} == {*summary.channels}
    assert all(record.id in summary.schemas for record in records if isinstance(record, Schema))
    assert all(record.id in summary.channels for record in records if isinstance(record, Channel))
    times = [message.log_time for message in messages] or [0]
    assert (statistics.message_start_time, statistics.message_end_time) == (min(times), max(times))
    assert statistics.message_count == len(messages)
