"""The topics and messages of any bag: rosbag2's, our own, and damaged ones."""

from __future__ import annotations

from collections import Counter, deque
from contextlib import suppress
from functools import lru_cache
from heapq import heappop, heappush
from typing import TYPE_CHECKING, Any

from barc_sim.bags import bounds
from barc_sim.bags.bag_files import SQLITE, custom_data, files, suffix_of
from barc_sim.bags.bounds import Budget
from barc_sim.bags.mcap_files import PACKED_MESSAGE, McapFile, unpacked
from barc_sim.bags.messages import Topic
from barc_sim.bags.metadata import Span
from barc_sim.cli.yaml_files import from_yaml

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator
    from pathlib import Path

    from mcap.records import Channel, Schema

    from barc_sim.bags.bag_files import BagFile, Damage
    from barc_sim.bags.messages import BagMessage

#: [ns] by which a message may stand behind later messages in a file.
_DISORDER = 2_000_000_000
#: What the names of metadata on lost messages begin with.
_LOSSES = ('lost ', 'lost_messages', 'not recorded ')


class Contents:
    """The contents of a bag: topics and metadata are read at once, and messages by `messages`.

    Parameters
    ----------
    path
        The bag's directory, or one of its files.
    timed
        Whether the time for all reading is limited.

    Attributes
    ----------
    topics
        The topics, in the order of the bag; a name with messages of two types has two.
    files
        The bag's files.
    metadata, attachments
        The run's metadata, or else rosbag2's custom data, and the attached files by name.

    Raises
    ------
    UserError
        There is no bag, it cannot be read, or it exceeds a bound.
    """

    def __init__(self, path: Path, *, timed: bool = False) -> None:
        self.path = path
        self.topics: list[Topic] = []
        self._by_content: dict[tuple[Any, ...], Topic] = {}  # equal topics of all files are one
        self._definitions: dict[bytes, str] = {}  # equal schemas of all topics are stored once
        self._counts: Counter[int] = Counter()  # number of messages read, by identity of the topic
        self._read_spans: list[Span] = []  # of the messages read in each file
        self.metadata: dict[str, str] = {}
        self.attachments: dict[str, bytes] = {}
        paths = files(path)
        self._budget = Budget(paths, timed=timed)
        self.files: list[BagFile] = []
        for file in paths:
            self.files.append(self._open(file, is_alone=len(paths) == 1))
        if not self.metadata:
            self.metadata.update(custom_data(path))

    def _open(self, file: Path, *, is_alone: bool) -> BagFile:
        """Return a file of the bag, whose topics are added."""
        if suffix_of(file) != SQLITE:
            return McapFile(file, self, self._budget, is_alone=is_alone)
        from barc_sim.bags.sqlite import SqliteFile  # noqa: PLC0415 (15 ms, for few bags)

        return SqliteFile(file, self, self._budget, is_alone=is_alone)

    @property
    def spans(self) -> list[Span]:
        """The time span of each file: of the messages that were read, or else of all."""
        return self._read_spans or [file.span for file in self.files]

    @property
    def span(self) -> Span:
        """The time span of all messages, or of the messages that were read."""
        return sum(self.spans, Span())

    @property
    def damages(self) -> dict[str, Damage]:
        """The damage of each damaged file, by the file's name."""
        return {file.path.name: file.damage for file in self.files if file.damage}

    def topic(self, channel: Channel, schema: Schema | None) -> Topic:
        """Return the topic of a channel, the same one for equal channels of all files."""
        schema_content = (schema.name, schema.encoding, schema.data) if schema else None
        metadata = tuple(channel.metadata.items())
        content = (channel.topic, channel.message_encoding, schema_content, metadata)
        if content not in self._by_content:
            topic = self._make_topic(channel, schema)
            self._by_content[content] = topic
            self.topics.append(topic)
        return self._by_content[content]

    def _make_topic(self, channel: Channel, schema: Schema | None) -> Topic:
        data = schema.data if schema else b''
        text = self._definitions.setdefault(data, data.decode(errors='surrogateescape'))
        return Topic(
            name=channel.topic,
            type=schema.name if schema else '',
            definition=text,
            type_hash=channel.metadata.get('topic_type_hash', ''),
            offered_qos=_offered_qos(channel.metadata.get('offered_qos_profiles', '')),
            schema_encoding=schema.encoding if schema else None,
            message_encoding=channel.message_encoding,
            metadata=channel.metadata,
        )

    @property
    def names(self) -> list[str]:
        """The topics' names, each once."""
        return list(dict.fromkeys(topic.name for topic in self.topics))

    @property
    def counted(self) -> list[tuple[Topic, int]]:
        """The topics with the number of messages that were read, by name."""
        topics = sorted(self.topics, key=lambda topic: topic.name)
        return [(topic, self._counts[id(topic)]) for topic in topics]

    def complete(self) -> None:
        """Read the files without a summary, to find their topics and time spans."""
        for file in self.files:
            if file.has_summary or file.span.count:
                continue
            span = Span()
            for message in file.messages():
                span.add(message.received)
            file.span = span

    def read_all(self) -> None:
        """Read all messages, so that they are counted and their damage is found."""
        deque(self.messages(), maxlen=0)

    def messages(self, start: int | None = None) -> Iterator[BagMessage]:
        """Yield the messages in the order of the bag, up to its damage.

        Parameters
        ----------
        start
            The time of reception [ns] of the first message to yield. A file with an index is read
            from there; another one is read from its beginning. None: all messages are read.
        """
        self._counts = Counter()
        self._read_spans = [Span() for _ in self.files]
        self._budget.renew()
        for file, span in zip(self.files, self._read_spans, strict=True):
            if start is not None and file.has_summary and file.span.count and file.span.end < start:
                continue
            for message in self.messages_of(file, start):
                self._counts[id(message.topic)] += 1
                span.add(message.received)
                yield message

    def messages_of(self, file: BagFile, start: int | None = None) -> Iterator[BagMessage]:
        """Yield the messages of one file of the bag, uncounted; `start` is as for `messages`."""
        return map(self._with_unpacked_data, file.messages(start))

    def blocks_before(
        self, end: int, wants: Callable[[Collection[int], int], bool]
    ) -> Iterator[Iterator[BagMessage]]:
        """Yield blocks of messages that lie before a time, the last block first.

        A block has its messages in the order of the bag.

        Parameters
        ----------
        end
            The time [ns]; a block can have later messages, too.
        wants
            Called with the identities of the topics that a block can have, and its last time
            [ns]; it returns whether to read the block.
        """
        self._budget.renew()
        for file in reversed(self.files):
            for block in file.blocks_before(end, wants):
                yield map(self._with_unpacked_data, block)

    def in_order(self, start: int | None = None) -> Iterator[BagMessage]:
        """Yield the messages in order of reception, if none is more than 2 s behind a later one.

        `start` is as for `messages`.
        """
        # Of messages received at the same time, the first in the bag comes first.
        waiting: list[tuple[int, int, BagMessage]] = []
        for number, message in enumerate(self.messages(start)):
            heappush(waiting, (message.received, number, message))
            while waiting[0][0] < message.received - _DISORDER:
                _, _, earliest = heappop(waiting)
                yield earliest

        while waiting:
            _, _, earliest = heappop(waiting)
            yield earliest

    def _with_unpacked_data(self, message: BagMessage) -> BagMessage:
        """Return a message, unpacked if rosbag2 has compressed it."""
        if not message.data.startswith(PACKED_MESSAGE):
            return message
        try:
            decompressed = unpacked(message.data, self._budget.max_chunk)
        except Exception:  # noqa: BLE001 (damage may raise anything)
            return message
        self._budget.charge(len(decompressed))
        return message._replace(data=decompressed)


@lru_cache(maxsize=16)
def _offered_qos(text: str) -> list[dict[str, Any]]:
    """Return the QoS profiles in a channel's metadata; those that cannot be read are left out."""
    if len(text) > bounds.MAX_QOS:
        return []
    profiles: Any = None
    with suppress(ValueError):
        profiles = from_yaml(text)
    if not isinstance(profiles, list):
        return []
    return [profile for profile in profiles if isinstance(profile, dict)]


def describe(path: Path) -> dict[str, Any]:
    """Read a whole bag and return a description of it, in JSON's types, with times in seconds.

    Parameters
    ----------
    path
        The bag's directory, or one of its files.

    Raises
    ------
    UserError
        There is no bag, or it cannot be read.
    """
    contents = Contents(path)
    contents.read_all()
    topics = [
        {
            'name': topic.name,
            'type': topic.type,
            'encoding': topic.message_encoding,
            'messages': count,
        }
        for topic, count in contents.counted
    ]
    losses: dict[str, str] = {}
    metadata: dict[str, str] = {}
    for name, text in contents.metadata.items():
        if name.startswith(_LOSSES):
            losses[name] = text
        else:
            metadata[name] = text

    files_and_spans = zip(contents.files, contents.spans, strict=True)
    file_spans = {file.path.name: _in_seconds(span) for file, span in files_and_spans}
    return {
        'path': str(path),
        'files': {file.path.name: file.path.stat().st_size for file in contents.files},
        'file_spans': file_spans,
        **_in_seconds(contents.span),
        'topics': topics,
        'losses': losses,
        'damages': {name: vars(damage) for name, damage in contents.damages.items()},
        'metadata': metadata,
    }


def _in_seconds(span: Span) -> dict[str, Any]:
    """Return the part of a description on the messages of a bag or of a file."""
    return {
        'start': (span.start or 0) / 1e9,
        'start_nanoseconds': span.start or 0,  # a float has not all digits
        'duration': span.duration / 1e9,
        'messages': span.count,
    }
