"""Recovers a bag whose run was killed, or whose files are damaged."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from secrets import token_hex
from typing import TYPE_CHECKING, Any

from mcap.records import Attachment, Channel, McapRecord, Message, Metadata

from barc_sim.bags import bounds
from barc_sim.bags.file import BagFile, is_being_written
from barc_sim.bags.recording import METADATA_NAME, Span, Topic, information, write_metadata
from barc_sim.bags.records import Channels, Damage, budget_of, files, records
from barc_sim.cli.files import check_plain
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from barc_sim.bags.bounds import Budget


@dataclass
class Recovered:
    """What was recovered of a bag."""

    spans: dict[str, Span] = field(default_factory=dict)  #: by the files' names
    topics: dict[str, Topic] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)  #: of messages, by topic
    metadata: dict[str, str] = field(default_factory=dict)  #: the run's own
    damages: dict[str, Damage] = field(default_factory=dict)  #: by the damaged files' names
    kept: list[Path] = field(default_factory=list)  #: damaged files as they were

    @property
    def span(self) -> Span:
        """The span of all messages."""
        return sum(self.spans.values(), Span())


def recover(path: Path) -> Recovered:
    """Rewrite the damaged files of a bag, with their summaries, and its metadata.yaml.

    A damaged file is replaced once its successor is whole. If more than its last chunk was
    unreadable, the old one is kept as `<name>.damaged`. UserError: there is no bag, it is still
    being recorded, nothing in it can be read, or the files cannot be written; the bag is unchanged.
    """
    directory = files(path)[0].parent
    check_plain(directory)
    found = Recovered()
    damaged = files(directory)
    budget = budget_of(damaged)
    try:
        for file in damaged:
            _recover_file(file, found, budget)
        write_metadata(directory, _information(found))
    except OSError as error:
        raise UserError(
            f'{str(directory)!r} cannot be recovered ({error.strerror}): copy it to a folder with '
            'space, and recover it there'
        ) from error
    return found


def _recover_file(file: Path, found: Recovered, budget: Budget) -> None:
    if is_being_written(file):
        raise UserError(f'{str(file)!r} is being recorded: end the recording first')
    part = file.with_name(f'.{token_hex(8)}.part')
    damage = Damage()
    copy = _Copy(BagFile(part), found)
    try:
        for record in records(file, budget, damage=damage):
            copy.add(record)
        found.spans[file.name] = copy.file.span
        found.counts.update(copy.file.counts)
        for topic in copy.file.topics.values():
            found.topics.setdefault(topic.name, topic)
        if not damage:
            return
        found.damages[file.name] = damage
        copy.file.finish(_information(found))
        copy.file.commit()
        if damage.unreadable_chunks or not damage.cut:
            found.kept.append(file.rename(_unused(file)))
        part.replace(file)
    finally:
        copy.file.appender.close()
        part.unlink(missing_ok=True)


def _unused(file: Path) -> Path:
    path, number = file.with_name(f'{file.name}.damaged'), 2
    while path.exists():
        path, number = file.with_name(f'{file.name}.damaged{number}'), number + 1
    return path


class _Copy:
    """Copies the records of a file."""

    def __init__(self, file: BagFile, found: Recovered) -> None:
        self.file = file
        self._found = found
        self._topics = Channels(file.path)

    def add(self, record: McapRecord) -> None:
        self._topics.add(record)
        if isinstance(record, Channel):
            bounds.check_topics(self.file.path, len(self.file.topics))
        elif isinstance(record, Metadata) and record.name == METADATA_NAME:
            self._found.metadata.update(record.metadata)
            bounds.check_entries(self.file.path, self._found.metadata)
            self.file.end_chunk()
            self.file.add_metadata(record.metadata)
        elif isinstance(record, Attachment):
            self.file.end_chunk()
            self.file.attach(record.name, record.media_type, record.data, record.create_time)
        elif isinstance(record, Message) and record.channel_id in self._topics:
            topic = self._topics[record.channel_id]
            if self.file.add(
                topic, record.data, record.log_time, record.publish_time, record.sequence
            ):
                self.file.commit()


def _information(found: Recovered) -> Mapping[str, Any]:
    topics = [(topic, found.counts[name]) for name, topic in found.topics.items()]
    return information(found.spans, topics, found.metadata)
