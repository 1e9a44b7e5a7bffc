"""A bag's metadata, in rosbag2's version 9."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import yaml

from barc_sim.cli.files import replacing

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

#: Name of the MCAP metadata records with the run's own metadata.
METADATA_NAME = 'barc_sim'


@dataclass(frozen=True, kw_only=True)
class Topic:
    """A bag's record of a topic."""

    name: str
    type: str  #: as in `std_msgs/msg/Header`
    definition: str  #: `ros2msg` schema with dependencies
    type_hash: str  #: as in `RIHS01_…`
    offered_qos: Sequence[Mapping[str, Any]]  #: of each publisher, in rosbag2's terms


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
        if self.start is None or other.start is None:
            return other if self.start is None else self
        return Span(
            min(self.start, other.start), max(self.end, other.end), self.count + other.count
        )

    def as_metadata(self) -> dict[str, Any]:
        """Return the entries of the metadata."""
        return {
            'duration': {'nanoseconds': self.end - (self.start or 0)},
            'starting_time': {'nanoseconds_since_epoch': self.start or 0},
            'message_count': self.count,
        }


def information(
    files: Mapping[str, Span], topics: Sequence[tuple[Topic, int]], custom: Mapping[str, str]
) -> dict[str, Any]:
    """Return a bag's metadata.

    Parameters
    ----------
    files
        The span of each file, by its name.
    topics
        The topics, each with the number of its messages.
    custom
        The run's own metadata.
    """
    return {
        'version': 9,
        'storage_identifier': 'mcap',
        **sum(files.values(), Span()).as_metadata(),
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': topic.name,
                    'type': topic.type,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': [dict(qos) for qos in topic.offered_qos],
                    'type_description_hash': topic.type_hash,
                },
                'message_count': count,
            }
            for topic, count in topics
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': list(files),
        'files': [{'path': name, **span.as_metadata()} for name, span in files.items()],
        'custom_data': dict(custom),
        'ros_distro': 'jazzy',
    }


def write(directory: Path, information: Mapping[str, Any]) -> None:
    """Write metadata.yaml, whole or not at all."""
    text = to_yaml({'rosbag2_bagfile_information': information})
    with replacing(directory / 'metadata.yaml') as part:
        part.write_text(text, encoding='utf-8')


# PyYAML's wheels have libyaml, which writes 40 cars' metadata in 0.1 s; a source build may lack it.
class _Dumper(getattr(yaml, 'CSafeDumper', yaml.SafeDumper)):  # type: ignore[misc]
    """Writes equal values out each time, as rosbag2's files have no anchors."""

    def ignore_aliases(self, data: object) -> bool:  # noqa: ARG002
        return True


def to_yaml(value: object) -> str:
    """Return `value` as YAML in the style of rosbag2."""
    return yaml.dump(value, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=2**31 - 1)
