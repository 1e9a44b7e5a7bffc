"""Recovers a bag whose run was killed, or whose files are damaged."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from secrets import token_hex
from typing import TYPE_CHECKING, Any

from barc_sim.bags.contents import Contents
from barc_sim.bags.file import BagFile, is_being_written
from barc_sim.bags.recording import Span, Topic, information, write_metadata
from barc_sim.bags.records import files
from barc_sim.cli.files import check_plain
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from barc_sim.bags.records import Damage, McapFile


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

    def information(self) -> Mapping[str, Any]:
        """Return the bag's metadata.yaml."""
        topics = [(topic, self.counts[name]) for name, topic in self.topics.items()]
        return information(self.spans, topics, self.metadata)


def recover(path: Path) -> Recovered:
    """Rewrite the damaged files of a bag, with their summaries, and its metadata.yaml.

    A damaged file is replaced once its successor is whole. If more than its last chunk was
    unreadable, the old one is kept as `<name>.damaged`. UserError: there is no bag, it is still
    being recorded, nothing in it can be read, or the files cannot be written; the bag is unchanged.
    """
    directory = files(path)[0].parent
    check_plain(directory)
    found = Recovered()
    try:
        for file in Contents(directory, run=True).files:
            _recover_file(file, found)
        write_metadata(directory, found.information())
    except OSError as error:
        raise UserError(
            f'{str(directory)!r} cannot be recovered ({error.strerror}): copy it to a folder with '
            'space, and recover it there'
        ) from error
    return found


def _recover_file(file: McapFile, found: Recovered) -> None:
    path = file.path
    if is_being_written(path):
        raise UserError(f'{str(path)!r} is being recorded: end the recording first')
    part = path.with_name(f'.{token_hex(8)}.part')
    copy = BagFile(part)
    try:
        copy.add_metadata(file.metadata)
        for each in file.attachments.values():
            copy.attach(each.name, each.media_type, each.data, each.create_time)
        for message in file.messages():
            copy.add([message])
            copy.commit()
        copy.end_chunk()
        found.spans[path.name] = copy.span
        found.counts.update(copy.counts)
        found.metadata |= file.metadata
        found.topics |= {topic.name: topic for topic in copy.topics.values()}
        if not file.damage:
            return
        found.damages[path.name] = file.damage
        copy.finish(found.information())
        copy.commit()
        if file.damage.unreadable_chunks or not file.damage.cut:
            found.kept.append(path.rename(_unused(path)))
        part.replace(path)
    finally:
        copy.appender.close()
        part.unlink(missing_ok=True)


def _unused(file: Path) -> Path:
    path, number = file.with_name(f'{file.name}.damaged'), 2
    while path.exists():
        path, number = file.with_name(f'{file.name}.damaged{number}'), number + 1
    return path
