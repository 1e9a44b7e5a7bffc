"""What a bag has beside its messages: metadata.yaml, the run's own metadata, and its track."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import yaml

from barc_sim.cli.files import replacing

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from barc_sim.bags.messages import Topic
    from barc_sim.vehicle.track import Track

#: Name of the MCAP metadata records with the run's own metadata.
METADATA_NAME = 'barc_sim'
_NEVER = 2**63 - 1  #: [ns] when a file without messages starts, as in rosbag2
TRACK_NAME = 'track.json'  #: name of the attached file with the track of a run


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
    files: Sequence[tuple[str, Span]],
    topics: Sequence[tuple[Topic, int]],
    custom: Mapping[str, str],
) -> dict[str, Any]:
    """Return the content of metadata.yaml.

    Parameters
    ----------
    files
        The bag's files in order, each with its name and the time span of its messages.
    topics
        The bag's topics with their numbers of messages.
    custom
        The run's own metadata.
    """
    span = sum((span for _, span in files), Span())
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
        'relative_file_paths': [name for name, _ in files],
        'files': [_file_metadata(name, span) for name, span in files],
        'custom_data': dict(custom),
        'ros_distro': 'jazzy',
    }


def _file_metadata(name: str, span: Span) -> dict[str, Any]:
    entries = {'path': name, **span.as_metadata()}
    if span.start is None:
        entries['starting_time'] = {'nanoseconds_since_epoch': _NEVER}
    return entries


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


def track_file(track: Track) -> dict[str, bytes]:
    """Return the attached file of a track: its segments, width, name and start."""
    fields = [track.lengths, track.curvatures, track.width, track.name, track.start]
    return {TRACK_NAME: json.dumps(fields).encode()}
