"""The topics and messages of any bag: rosbag2's MCAP and sqlite3, our own, and damaged ones."""

from __future__ import annotations

from collections import Counter, deque
from contextlib import suppress
from heapq import heappop, heappush
from itertools import chain
from typing import TYPE_CHECKING, Any

import zstandard
from rosbags.interfaces import Nodetype
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.metadata import dump_qos_v9
from rosbags.typesys import get_types_from_idl, get_types_from_msg

from barc_sim.bags import bounds
from barc_sim.bags.bounds import Budget
from barc_sim.bags.messages import Message
from barc_sim.bags.recording import Span, Topic
from barc_sim.bags.records import Damage, McapFile, files, unpacked
from barc_sim.bags.schemas import definition
from barc_sim.cli.files import check_plain
from barc_sim.errors import UserError

if TYPE_CHECKING:
    import re
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

_ZSTD = b'\x28\xb5\x2f\xfd'  # begins what rosbag2 has compressed; CDR begins with a zero
#: [ns] by which a message may stand behind later ones.
_DISORDER = 2_000_000_000
_IDL = '=' * 80 + '\nIDL: '
_LOSSES = ('lost ', 'lost_messages', 'not recorded ')


class Contents:
    """What is in a bag: what its files describe at once, the rest as `messages` reads them.

    Attributes
    ----------
    topics
        By name.
    sources, files
        Its files; and of these the MCAP files, unless rosbags reads the bag.
    counts
        The number of messages that were read, by topic.
    span
        Of all messages, or of those that were read.
    metadata, attachments
        The run's own, and the attached files by their names.
    damages
        By the damaged files' names.
    """

    def __init__(self, path: Path, *, run: bool = False) -> None:
        """Find and describe the bag at `path`: its directory, or one of the files.

        Of a `run` there are only MCAP files, and to read them takes limited time.

        Raises
        ------
        UserError
            There is no bag, it cannot be read, or it exceeds a bound.
        """
        self.path = path
        self.topics: dict[str, Topic] = {}
        self.counts: Counter[str] = Counter()
        self.span = Span()
        self.metadata: dict[str, str] = {}
        self.attachments: dict[str, bytes] = {}
        self.damages: dict[str, Damage] = {}
        self.files: list[McapFile] = []
        # What rosbags reads: a whole directory if it can be, as its files may be compressed.
        self._others = [] if run else _others(path)
        of_others = (each.iterdir() if each.is_dir() else [each] for each in self._others)
        self.sources = sorted(chain(*of_others)) or files(path)
        self._budget = Budget(self.sources, timed=run)
        for source in self.sources if self._others else ():
            self._charge_unpacked(source)
        for source in self._others:
            self._describe_other(source)
        for file in [] if self._others else self.sources:
            self.files.append(McapFile(file, self._budget))
            self._describe(self.files[-1])
            self.span += self.files[-1].span or Span()

    def _describe(self, file: McapFile) -> None:
        self.topics |= file.topics
        self.metadata |= file.metadata
        self.attachments |= {name: each.data for name, each in file.attachments.items()}
        if file.damage:
            self.damages[file.path.name] = file.damage
        bounds.check_topics(self.path, len(self.topics))
        bounds.check_entries(self.path, self.metadata)
        bounds.check_attached(self.path, sum(map(len, self.attachments.values())))

    def _charge_unpacked(self, source: Path) -> None:
        """Charge what a file unpacks to that rosbags unpacks whole, on the disk."""
        if source.suffix != '.zstd':
            return
        with source.open('rb') as file, suppress(zstandard.ZstdError):
            for piece in zstandard.ZstdDecompressor().read_to_iter(file):
                self._budget.charge(len(piece))

    def _describe_other(self, source: Path) -> None:
        try:
            with Reader(source) as reader:
                self.metadata |= getattr(reader.storage.metadata, 'custom', None) or {}
                self.topics |= {each.topic: _topic(each) for each in reader.connections}
                self.span += Span(reader.start_time, reader.end_time - 1, reader.message_count)
        except Exception as error:  # noqa: BLE001 (damage may raise anything)
            raise UserError(f'{str(source)!r} cannot be read ({error}): name another bag') from None

    def complete(self) -> None:
        """Find topics and span in the messages where a file has no summary of them."""
        if any(file.span is None for file in self.files):
            deque(self.messages(), maxlen=0)

    def messages(self) -> Iterator[Message]:
        """Yield the messages in the order of the bag, up to its damage."""
        by_file = self.by_file()
        for source in self._others:
            yield from self._counted(self._of_other(source))
        for _, messages in by_file:
            yield from messages

    def by_file(self) -> Iterator[tuple[McapFile, Iterator[Message]]]:
        """Begin a reading; return an iterator of the MCAP files, each with its messages."""
        self.counts, self.span = Counter(), Span()
        self._budget.renew()

        def read() -> Iterator[tuple[McapFile, Iterator[Message]]]:
            for file in self.files:
                yield file, self._counted(file.messages())
                self._describe(file)

        return read()

    def _counted(self, messages: Iterable[Message]) -> Iterator[Message]:
        for message in messages:
            self.counts[message.topic.name] += 1
            self.span.add(message.received)
            if message.data.startswith(_ZSTD):
                yield message._replace(data=self._unpacked(message.data))
            else:
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

    def _of_other(self, source: Path) -> Iterator[Message]:
        try:
            with Reader(source) as reader:
                for number, (connection, time, data) in enumerate(reader.messages(), 1):
                    topic = self.topics[connection.topic]
                    yield Message(topic, bytes(data), time, time, number)
        except Exception:  # noqa: BLE001 (damage may raise anything)
            self.damages[source.name] = Damage(unfinished=True)

    def _unpacked(self, data: bytes) -> bytes:
        """Return a message without the compression that rosbag2 can give it."""
        try:
            whole = unpacked(data, bounds.MAX_RECORD)
        except Exception:  # noqa: BLE001 (damage may raise anything)
            return data
        self._budget.charge(len(whole))
        return whole


def _others(path: Path) -> list[Path]:
    """Return what rosbags reads of the bag at `path`: nothing where there are MCAP files."""
    if path.suffix == '.db3' and path.is_file():
        return [path]
    if not path.is_dir() or any(path.glob('*.mcap')):
        return []
    check_plain(path)
    return [path] if (path / 'metadata.yaml').exists() else sorted(path.glob('*.db3'))


def _topic(connection: Any) -> Topic:  # noqa: ANN401 (rosbags' own)
    return Topic(
        name=connection.topic,
        type=connection.msgtype,
        definition=str(connection.msgdef.data),
        type_hash=connection.digest,
        offered_qos=dump_qos_v9(getattr(connection.ext, 'offered_qos_profiles', [])),
    )


def selected(
    names: Sequence[str], topics: Sequence[re.Pattern[str]], exclude: Sequence[re.Pattern[str]]
) -> list[str]:
    """Return those of a bag's topics that are `topics` or contain them, but for `exclude`.

    Without `topics` these are all.
    """

    def among(name: str, patterns: Sequence[re.Pattern[str]]) -> bool:
        return any(
            each.pattern == name if each.pattern in names else each.search(name)
            for each in patterns
        )

    return [
        name for name in names if (not topics or among(name, topics)) and not among(name, exclude)
    ]


def types_of(topic: Topic) -> dict[str, Any]:
    """Return the types in a topic's definition; ValueError: it is far beyond those of robots."""
    text = topic.definition or definition(topic.type)
    if len(text) > bounds.MAX_SCHEMA:
        raise ValueError(f'its definition has {len(text)} characters')
    types: dict[str, Any] = {}
    if text.startswith(_IDL):
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
    return types


def describe(path: Path) -> dict[str, Any]:
    """Read a whole bag; return what is in it, in JSON's types, times in seconds.

    Raises
    ------
    UserError
        There is no bag, or it cannot be read.
    """
    contents = Contents(path)
    deque(contents.messages(), maxlen=0)
    span, metadata = contents.span, contents.metadata
    losses = {k: v for k, v in metadata.items() if k.startswith(_LOSSES)}
    return {
        'path': str(path),
        'files': {file.name: file.stat().st_size for file in contents.sources},
        'start': (span.start or 0) / 1e9,
        'duration': span.duration / 1e9,
        'messages': span.count,
        'topics': [
            {'name': name, 'type': topic.type, 'messages': contents.counts[name]}
            for name, topic in sorted(contents.topics.items())
        ],
        'losses': losses,
        'damages': {name: vars(damage) for name, damage in contents.damages.items()},
        'metadata': {name: text for name, text in metadata.items() if name not in losses},
    }
