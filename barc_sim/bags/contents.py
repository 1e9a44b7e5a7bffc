"""The topics and messages of any bag: rosbag2's MCAP and sqlite3, our own, and damaged ones."""

from __future__ import annotations

from collections import Counter
from heapq import heappop, heappush
from typing import TYPE_CHECKING

import zstandard
from mcap.records import Channel, Metadata, Schema, Statistics
from mcap.records import Message as Record
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.metadata import dump_qos_v9

from barc_sim.bags import bounds
from barc_sim.bags.bounds import Budget
from barc_sim.bags.messages import Message
from barc_sim.bags.recording import METADATA_NAME, Span, Topic
from barc_sim.bags.records import Channels, Damage, budget_of, files, records
from barc_sim.cli.files import check_plain
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from rosbags.interfaces import Connection

_ZSTD = b'\x28\xb5\x2f\xfd'  # begins what rosbag2 has compressed; CDR begins with a zero
#: [ns] by which a message may stand behind later ones.
_DISORDER = 2_000_000_000


class Contents:
    """What is in a bag. `outline` and `messages` fill the attributes as they read.

    Attributes
    ----------
    topics
        By name.
    sources
        Its files, or a directory whose files rosbags reads.
    counts
        The number of messages that were read, by topic.
    span
        Of all messages, or of those that were read.
    metadata
        The run's own.
    damages
        By the damaged files' names.
    """

    def __init__(self, path: Path) -> None:
        """Find the files of the bag at `path`: its directory, or one of the files.

        Raises
        ------
        UserError
            There is none.
        """
        self.path = path
        self.topics: dict[str, Topic] = {}
        self.counts: Counter[str] = Counter()
        self.span = Span()
        self.metadata: dict[str, str] = {}
        self.damages: dict[str, Damage] = {}
        # What rosbags reads: a whole directory if it can be, as its files may be compressed.
        self._others = _others(path)
        self._files = [] if self._others else files(path)
        self.sources = self._others or self._files

    def outline(self) -> None:
        """Read topics and span: from the files' summaries, and from all messages without them."""
        for source in self._others:
            list(self._of_other(source, messages=False))
        budget = budget_of(self._files) if self._files else None
        for file in self._files:
            channels, found = Channels(file), []
            for record in records(file, budget, messages=False, damage=Damage()):
                channels.add(record)
                found += [record] if isinstance(record, Statistics) else []
            self._add(channels)
            for each in found:
                span = Span(each.message_start_time, each.message_end_time, each.message_count)
                self.span += span if span.count else Span()
            if not found:
                self.span += sum((Span(m.received, m.received, 1) for m in self._of(file)), Span())

    def messages(self) -> Iterator[Message]:
        """Yield the messages in the order of the bag, up to its damage."""
        self.counts, self.span = Counter(), Span()
        for source in (*map(self._of_other, self._others), *map(self._of, self._files)):
            for message in source:
                self.counts[message.topic.name] += 1
                self.span.add(message.received)
                yield message

    def in_order(self) -> Iterator[Message]:
        """Yield the messages by their time of reception, unless one is 2 s behind a later one."""
        waiting: list[tuple[int, int, Message]] = []
        for number, message in enumerate(self.messages()):
            heappush(waiting, (message.received, number, message))
            while waiting[0][0] < message.received - _DISORDER:
                yield heappop(waiting)[2]
        while waiting:
            yield heappop(waiting)[2]

    def _add(self, topics: Mapping[int, Topic]) -> None:
        self.topics |= {topic.name: topic for topic in topics.values()}

    def _of(self, file: Path) -> Iterator[Message]:
        channels, damage = Channels(file), Damage()
        for record in records(file, Budget([file], timed=False), damage=damage):
            if isinstance(record, Record):
                if topic := channels.get(record.channel_id):
                    yield Message(
                        topic,
                        _unpacked(record.data),
                        record.log_time,
                        record.publish_time,
                        record.sequence,
                    )
            elif isinstance(record, Metadata) and record.name == METADATA_NAME:
                self.metadata.update(record.metadata)
                bounds.check_entries(file, self.metadata)
            elif isinstance(record, (Schema, Channel)):
                channels.add(record)
                self._add(channels)
        if damage:
            self.damages[file.name] = damage

    def _of_other(self, source: Path, *, messages: bool = True) -> Iterator[Message]:
        """Yield what rosbags reads; without `messages` only topics and span are added."""
        try:
            with Reader(source) as reader:
                self.metadata |= getattr(reader.storage.metadata, 'custom', None) or {}
                topics = {each.id: _topic(each) for each in reader.connections}
                self._add(topics)
                if not messages:
                    self.span += Span(reader.start_time, reader.end_time - 1, reader.message_count)
                    return
                of_all = reader.messages()
                for number, (connection, time, data) in enumerate(of_all, 1):
                    yield Message(topics[connection.id], _unpacked(data), time, time, number)
        except Exception as error:  # noqa: BLE001 (damage may raise anything)
            if not self.topics:
                raise UserError(
                    f'{str(source)!r} cannot be read ({error}): name another bag'
                ) from None
            self.damages[source.name] = Damage(unfinished=True)


def _others(path: Path) -> list[Path]:
    """Return what rosbags reads of the bag at `path`: nothing where there are MCAP files."""
    if path.suffix == '.db3' and path.is_file():
        return [path]
    if not path.is_dir() or any(path.glob('*.mcap')):
        return []
    check_plain(path)
    return [path] if (path / 'metadata.yaml').exists() else sorted(path.glob('*.db3'))


def _topic(connection: Connection) -> Topic:
    return Topic(
        name=connection.topic,
        type=connection.msgtype,
        definition=str(connection.msgdef.data),
        type_hash=connection.digest,
        offered_qos=dump_qos_v9(getattr(connection.ext, 'offered_qos_profiles', [])),
    )


def _unpacked(data: bytes) -> bytes:
    """Return a message without the compression that rosbag2 can give it."""
    if not data.startswith(_ZSTD):
        return bytes(data)
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=bounds.MAX_RECORD)
