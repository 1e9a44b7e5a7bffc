"""A recording's settings, directory and metadata.yaml, and its lost messages."""

from __future__ import annotations

import json
import os
import shutil
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import yaml

from barc_sim.cli.files import replacing
from barc_sim.errors import UserError
from barc_sim.interfaces.parameters import ParameterDeclaration
from barc_sim.interfaces.topics import CLOCK

if TYPE_CHECKING:
    import re
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from barc_sim.bags.messages import Topic
    from barc_sim.vehicle.track import Track

_MEBIBYTE = 2**20
#: Name of the MCAP metadata records with the run's own metadata.
METADATA_NAME = 'barc_sim'
_TRIES = 1000
BAG_DIR = ParameterDeclaration(
    'bag_dir', 'bags', 'folder to make the bag in, as a directory <date>_<time>', read_only=True
)
TRACK_NAME = 'track.json'  #: name of the attached file with the track of a run
#: The number of a message that the middleware does not number.
UNNUMBERED = 2**64 - 1


def selected(
    names: Sequence[str], topics: Sequence[re.Pattern[str]], exclude: Sequence[re.Pattern[str]]
) -> list[str]:
    """Return the names that contain one of `topics`, by default all, and none of `exclude`."""
    return [
        name
        for name in names
        if (not topics or _contains_any(name, topics)) and not _contains_any(name, exclude)
    ]


def _contains_any(name: str, patterns: Sequence[re.Pattern[str]]) -> bool:
    return any(pattern.search(name) for pattern in patterns)


@dataclass(frozen=True, kw_only=True)
class Recording:
    """The settings of a recording."""

    #: See `selected`; with `topics`, hidden ones are recorded, too.
    topics: Sequence[re.Pattern[str]] = field(default_factory=list)
    exclude: Sequence[re.Pattern[str]] = field(default_factory=list)
    depth: int = 10_000  #: queue length of a subscription: one second at 10,000 messages a second
    min_free_space: float = 64.0  #: [MiB] to leave free on the disk
    use_sim_time: bool = False  #: stamp messages with `/clock`; record none before the first one

    def needs(self, topic: str) -> bool:
        """Return whether to subscribe to a topic: to record it, or for its time."""
        return self.wants(topic) or (self.use_sim_time and topic == CLOCK)

    def wants(self, topic: str) -> bool:
        """Return whether to record a topic, given its full name."""
        is_hidden = '/_' in topic and not self.topics
        return not is_hidden and bool(selected([topic], self.topics, self.exclude))

    @property
    def reserve(self) -> int:
        """Space to leave free on the disk [B]."""
        return int(self.min_free_space * _MEBIBYTE)


@dataclass
class Span:
    """The time span and number of the messages in a file or a bag."""

    start: int | None = None  #: [ns] since the epoch; None without messages
    end: int = 0  #: [ns]
    count: int = 0

    def add(self, received: int) -> None:
        """Add a message, by its time of reception [ns]."""
        if self.start is None:
            self.start = self.end = received
        elif received < self.start:
            self.start = received
        elif received > self.end:
            self.end = received
        self.count += 1

    def __add__(self, other: Span) -> Span:
        """Return the span that covers both."""
        if self.start is None:
            return other
        if other.start is None:
            return self
        return Span(
            start=min(self.start, other.start),
            end=max(self.end, other.end),
            count=self.count + other.count,
        )

    @property
    def duration(self) -> int:
        """Time from the first message to the last [ns]."""
        return self.end - (self.start or 0)

    def as_metadata(self) -> dict[str, Any]:
        """Return the entries of the metadata."""
        return {
            'duration': {'nanoseconds': self.duration},
            'starting_time': {'nanoseconds_since_epoch': self.start or 0},
            'message_count': self.count,
        }


def information(
    file: str, span: Span, topics: Sequence[tuple[Topic, int]], custom: Mapping[str, str]
) -> dict[str, Any]:
    """Return the content of metadata.yaml for a bag of one file.

    Parameters
    ----------
    file
        The file's name.
    span
        The time span of its messages.
    topics
        Its topics with their numbers of messages.
    custom
        The run's own metadata.
    """
    return {
        'version': 9,
        'storage_identifier': 'mcap',
        **span.as_metadata(),
        'topics_with_message_count': [
            {'topic_metadata': _topic_metadata(topic), 'message_count': count}
            for topic, count in topics
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [file],
        'files': [{'path': file, **span.as_metadata()}],
        'custom_data': dict(custom),
        'ros_distro': 'jazzy',
    }


def _topic_metadata(topic: Topic) -> dict[str, Any]:
    return {
        'name': topic.name,
        'type': topic.type,
        'serialization_format': topic.message_encoding,
        'offered_qos_profiles': [dict(qos) for qos in topic.offered_qos],
        'type_description_hash': topic.type_hash,
    }


def write_metadata(directory: Path, information: Mapping[str, Any]) -> None:
    """Write metadata.yaml, whole or not at all."""
    text = to_yaml({'rosbag2_bagfile_information': information})
    with replacing(directory / 'metadata.yaml') as part:
        part.write_text(text, encoding='utf-8')


# PyYAML's wheels have libyaml, which writes 40 cars' metadata in 0.1 s; a source build may lack it.
class _Dumper(getattr(yaml, 'CSafeDumper', yaml.SafeDumper)):  # type: ignore[misc]
    """Writes equal values in full each time: rosbag2's files have no anchors."""

    def ignore_aliases(self, data: object) -> bool:  # noqa: ARG002
        return True


def to_yaml(value: object) -> str:
    """Return `value` as YAML in the style of rosbag2."""
    return yaml.dump(value, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=2**31 - 1)


def _existing(folder: Path) -> Path:
    """Return the folder, or the nearest folder above it that exists."""
    path = folder.absolute()
    return next(ancestor for ancestor in (path, *path.parents) if ancestor.exists())


def check_root(root: Path) -> None:
    """Raise UserError if no bag can be made in the folder `root`; nothing is written."""
    folder = _existing(root)
    reason = ''
    if not folder.is_dir():
        reason = f'{str(folder)!r} is not a folder'
    elif not os.access(folder, os.W_OK | os.X_OK):
        reason = f'{str(folder)!r} is not writable'
    if reason:
        raise UserError(f'no bag can be made in {str(root)!r}, as {reason}: name another folder')


def short_of_space(folder: Path, reserve: int) -> str | None:
    """Return why the disk of `folder` is too full, None if `reserve` [B] is free."""
    free = shutil.disk_usage(folder).free
    if free >= reserve:
        return None
    return (
        f'only {free / _MEBIBYTE:.1f} MiB are free, and {reserve / _MEBIBYTE:g} MiB must stay free'
    )


def check_space(folder: Path, reserve: int) -> None:
    """Raise UserError if less than `reserve` [B] is free for `folder`, which need not exist yet."""
    shortage = short_of_space(_existing(folder), reserve)
    if shortage:
        raise UserError(
            f'no bag can be made in {str(folder)!r}, as {shortage}: '
            'make space, name another folder, or lower --min-free-space'
        )


def make_directory(path: Path | None, root: Path) -> Path:
    """Make the directory of a bag and return it.

    Parameters
    ----------
    path
        The directory to make; None: a new one with a name `<date>_<time>`.
    root
        The folder for the latter.

    Raises
    ------
    UserError
        It cannot be made.
    """
    check_root(path.parent if path else root)
    for directory in [path] if path else _dated_paths(root):
        try:
            directory.mkdir(parents=True)
        except OSError as error:  # noqa: PERF203
            failure = error
            if not isinstance(error, FileExistsError):
                break
        else:
            return directory
    raise UserError(
        f'the bag {str(directory)!r} cannot be made ({failure.strerror}): name another folder'
    ) from failure


def _dated_paths(root: Path) -> Iterator[Path]:
    """Yield the paths to try for a bag without a name."""
    date = time.strftime('%Y-%m-%d_%H-%M-%S')
    yield root / date
    for number in range(2, _TRIES):
        yield root / f'{date}_{number}'


class Losses:
    """The lost messages of one topic, for each publisher.

    A publisher numbers its messages one by one. So a gap is a loss, wherever it happened: in the
    subscription, on the way, or in a publisher whose queue was too short. Losses before a
    publisher's first received message, or after its last one, are no gap.
    """

    def __init__(self) -> None:
        self._last: dict[bytes, int] = {}
        self.by_publisher: dict[bytes, int] = {}  #: number of lost messages, by publisher's GID
        self.unnumbered = False  #: whether a message had no number, so that losses are unknown

    def count(self, publisher: bytes, numbers: Sequence[int]) -> None:
        """Count the gaps in the rising `numbers` of a publisher's messages, since the last call."""
        last = self._last.get(publisher, numbers[0] - 1)
        self._last[publisher] = numbers[-1]
        if UNNUMBERED in numbers:
            self.unnumbered = True
            return

        lost = numbers[-1] - last - len(numbers)
        if lost > 0:
            self.by_publisher[publisher] = self.by_publisher.get(publisher, 0) + lost


@dataclass(frozen=True, kw_only=True)
class Missing:
    """The messages that a bag is known to lack."""

    lost: Mapping[str, Mapping[str, int]]  #: number of lost messages, by topic and publishing node
    unknown: Mapping[str, str] = field(default_factory=dict)  #: why more may be lost, by topic
    left_out: Mapping[str, str] = field(default_factory=dict)  #: why it is not recorded, by topic
    before_clock: int = 0  #: number of messages left out, as they came before the first `/clock`

    @property
    def total(self) -> int:
        """The number of messages that are known to be lost."""
        return sum(sum(by_node.values()) for by_node in self.lost.values())

    def as_metadata(self) -> dict[str, str]:
        """Return the entries of a bag's metadata."""
        return {'lost_messages': str(self.total), **dict(self._entries())}

    def _entries(self) -> Iterator[tuple[str, str]]:
        """Yield name and text of each entry."""
        for topic in sorted(self.lost.keys() | self.unknown.keys()):
            texts = []
            by_node = self.lost.get(topic)
            if by_node:
                parts = ', '.join(f'{count} of {node}' for node, count in sorted(by_node.items()))
                texts.append(f'{sum(by_node.values())} ({parts})')
            if topic in self.unknown:
                texts.append(f'unknown: {self.unknown[topic]}')
            if texts:
                yield f'lost {topic}', '; '.join(texts)
        for topic, why in sorted(self.left_out.items()):
            yield f'not recorded {topic}', why
        if self.before_clock:
            yield 'not recorded before /clock', f'{self.before_clock} messages'

    def summary(self, counts: Mapping[str, int]) -> str:
        """Return lines with the numbers of recorded and lost messages, and what is left out.

        `counts` has the number of recorded messages, by topic.
        """
        more = ' or more' if self.unknown else ''
        first = f'recorded {sum(counts.values())} messages, lost {self.total}{more}'
        return '\n'.join([first, *(f'{name}: {text}' for name, text in self._entries())])


def track_file(track: Track) -> dict[str, bytes]:
    """Return the attached file of a track: its segments, width, name and start."""
    fields = [track.lengths, track.curvatures, track.width, track.name, track.start]
    return {TRACK_NAME: json.dumps(fields).encode()}
