"""Writes a rosbag2 bag: a directory with an MCAP file and its metadata.yaml."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import yaml
from mcap.writer import CompressionType, Writer

from barc_sim.bag_directory import METADATA_NAME
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

# A chunk is what is lost if the process is killed. Compressing 64 KiB takes 0.2 ms, so it may be
# done in a callback; zstd costs 0.6 us a message more than none and writes 40 % of the bytes.
_CHUNK_SIZE = 64 * 1024


@dataclass(frozen=True, kw_only=True)
class Topic:
    """What a bag says of a topic."""

    name: str
    type: str  #: as in `std_msgs/msg/Header`
    definition: str  #: `ros2msg` schema with dependencies
    type_hash: str  #: as in `RIHS01_…`
    offered_qos: Sequence[Mapping[str, Any]]  #: of each publisher, in rosbag2's terms


@dataclass
class _Channel:
    topic: Topic
    count: int = 0


class BagWriter:
    """A bag that is being written to an empty directory; not to be shared among threads.

    Message data reaches the file in chunks, each with a checksum, when 64 KiB are together and
    at `flush`. `metadata.yaml` is written by `close`: a directory without it holds a bag whose
    run was killed, of which all but the last chunk is there.

    Parameters
    ----------
    directory
        Where to write; the file in it is named after it, as rosbag2 does.
    metadata
        What the run says of itself, kept in the file and in `custom_data` of metadata.yaml.

    Raises
    ------
    UserError
        The file exists or cannot be made.
    """

    def __init__(self, directory: Path, *, metadata: Mapping[str, str] | None = None) -> None:
        self.directory = directory
        self.file = directory / f'{directory.absolute().name}_0.mcap'
        try:
            self._stream = self.file.open('xb')
        except OSError as error:
            raise UserError(
                f'the bag {str(self.file)!r} cannot be made ({error.strerror}): name another folder'
            ) from error
        self._writer = Writer(
            self._stream,
            chunk_size=_CHUNK_SIZE,
            compression=CompressionType.ZSTD,
            enable_data_crcs=True,
        )
        self._writer.start(profile='ros2')
        self._schemas: dict[str, int] = {}
        self._channels: dict[int, _Channel] = {}
        self._metadata: dict[str, str] = {}
        self._start: int | None = None
        self._end = 0
        self.closed = False
        self.add_metadata(metadata or {})

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages written, by topic."""
        return {channel.topic.name: channel.count for channel in self._channels.values()}

    def add_metadata(self, entries: Mapping[str, str]) -> None:
        """Keep what the run says of itself; an entry of the same name replaces the earlier one."""
        self._metadata.update(entries)
        if entries:
            self._writer.add_metadata(METADATA_NAME, dict(entries))
        self.flush()

    def add_topic(self, topic: Topic) -> int:
        """Return the channel to write the topic's messages to.

        To be called when its first message is there: MCAP wants no channel without messages.
        """
        if topic.type not in self._schemas:
            self._schemas[topic.type] = self._writer.register_schema(
                topic.type, 'ros2msg', topic.definition.encode()
            )
        channel = self._writer.register_channel(
            topic.name,
            'cdr',
            self._schemas[topic.type],
            {
                'offered_qos_profiles': _to_yaml([dict(qos) for qos in topic.offered_qos]).rstrip(),
                'topic_type_hash': topic.type_hash,
            },
        )
        self._channels[channel] = _Channel(topic)
        return channel

    def write(
        self, channel: int, data: bytes, *, received: int, published: int, sequence: int
    ) -> None:
        """Append a message.

        Parameters
        ----------
        channel
            From `add_topic`.
        data
            The message in CDR, with its header.
        received, published
            [ns] since the epoch, by the subscriber's and the publisher's clock.
        sequence
            The publisher's count of its messages.
        """
        self._writer.add_message(channel, received, data, published, sequence & 0xFFFF_FFFF)
        self._channels[channel].count += 1
        self._start = received if self._start is None else min(self._start, received)
        self._end = max(self._end, received)

    def flush(self) -> None:
        """Hand all that was written to the operating system: killing the process loses nothing."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """Finish the file and write metadata.yaml; a second call does nothing."""
        if self.closed:
            return
        self.closed = True
        with self._stream:
            # rosbag2 keeps the metadata in the file, too, to read the file alone.
            self._writer.add_metadata(
                'rosbag2', {'serialized_metadata': _to_yaml(self._information())}
            )
            self._writer.finish()  # type: ignore[no-untyped-call]
        unfinished = self.directory / '.metadata.yaml'
        unfinished.write_text(
            _to_yaml({'rosbag2_bagfile_information': self._information()}), encoding='utf-8'
        )
        unfinished.replace(self.directory / 'metadata.yaml')

    def _information(self) -> dict[str, Any]:
        """Return what metadata.yaml holds, in version 9."""
        count = sum(self.counts.values())
        span = {
            'duration': {'nanoseconds': self._end - (self._start or 0) if count else 0},
            'starting_time': {'nanoseconds_since_epoch': self._start or 0},
            'message_count': count,
        }
        return {
            'version': 9,
            'storage_identifier': 'mcap',
            **span,
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': channel.topic.name,
                        'type': channel.topic.type,
                        'serialization_format': 'cdr',
                        'offered_qos_profiles': [dict(qos) for qos in channel.topic.offered_qos],
                        'type_description_hash': channel.topic.type_hash,
                    },
                    'message_count': channel.count,
                }
                for channel in self._channels.values()
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [self.file.name],
            'files': [{'path': self.file.name, **span}],
            'custom_data': self._metadata,
            'ros_distro': 'jazzy',
        }


class _Dumper(yaml.SafeDumper):
    """Writes equal values out each time: rosbag2's files have no anchors."""

    def ignore_aliases(self, data: object) -> bool:  # noqa: ARG002
        return True


def _to_yaml(value: object) -> str:
    return yaml.dump(value, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=2**31)
