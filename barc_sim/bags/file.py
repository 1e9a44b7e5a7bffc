"""One MCAP file of a bag."""

from __future__ import annotations

import time
from collections import Counter
from typing import TYPE_CHECKING, Any, cast

from mcap.writer import CompressionType, Writer

from barc_sim.bags.metadata import METADATA_NAME, Span, Topic, to_yaml
from barc_sim.bags.pieces import Pieces

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from typing import IO

#: [B] The greatest chunk, as rosbag2 has it. A file's summary, in memory until the file is closed,
#: needs a kilobyte for each chunk. zstd writes 40 % of the bytes for 0.6 us a message.
CHUNK_SIZE = 768 * 1024


class BagFile:
    """An MCAP file that is being written in chunks, each with a checksum.

    What `commit` cannot write is kept for the next `commit`.

    Raises
    ------
    OSError
        The file exists or cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.span = Span()
        self.pieces = Pieces(path)
        self.finished = False
        self.on_disk: Counter[str] = Counter()  #: messages that the system has taken, by topic
        self._in_pieces: Counter[str] = Counter()  # of finished chunks
        self._in_chunk: Counter[str] = Counter()  # of the chunk in progress
        self._writer = Writer(
            cast('IO[Any]', self.pieces),
            chunk_size=CHUNK_SIZE,
            compression=CompressionType.ZSTD,
            enable_data_crcs=True,
        )
        self._writer.start(profile='ros2')
        self._schemas: dict[tuple[str, str], int] = {}
        self._channels: dict[str, int] = {}

    @property
    def size(self) -> int:
        """Length [B], without the chunk in progress."""
        return self.pieces.tell()

    def add_metadata(self, entries: Mapping[str, str]) -> None:
        """Add metadata of the run."""
        self._writer.add_metadata(METADATA_NAME, dict(entries))

    def attach(self, name: str, media_type: str, data: bytes, modified: int = 0) -> None:
        """Attach a file with its time `modified` [ns] since the epoch; 0: unknown."""
        self._writer.add_attachment(modified, time.time_ns(), name, media_type, data)

    def add(self, topic: Topic, data: bytes, received: int, published: int, sequence: int) -> bool:
        """Append a message; return whether there is anything to commit."""
        channel = self._channels.get(topic.name)
        if channel is None:
            channel = self._channels[topic.name] = self._register(topic)
        before = self.size
        self._in_chunk[topic.name] += 1
        self._writer.add_message(channel, received, data, published, sequence & 0xFFFF_FFFF)
        if self.size != before:
            self._count_chunk()
        self.span.add(received)
        return self.pieces.waiting

    def _register(self, topic: Topic) -> int:
        schema = topic.type, topic.definition
        if schema not in self._schemas:
            self._schemas[schema] = self._writer.register_schema(
                topic.type, 'ros2msg', topic.definition.encode()
            )
        qos = to_yaml([dict(qos) for qos in topic.offered_qos]).rstrip()
        return self._writer.register_channel(
            topic.name,
            'cdr',
            self._schemas[schema],
            {'offered_qos_profiles': qos, 'topic_type_hash': topic.type_hash},
        )

    def _count_chunk(self) -> None:
        self._in_pieces += self._in_chunk
        self._in_chunk.clear()

    def end_chunk(self) -> None:
        """End the chunk in progress, so that it can be committed."""
        if not self.finished:
            self._writer.flush()  # type: ignore[no-untyped-call]
            self._count_chunk()

    def commit(self) -> None:
        """Write the finished chunks, and close the file if it is finished.

        Raises
        ------
        OSError
            The system refused; the file is whole up to the last commit.
        """
        if self.pieces.waiting:
            self.pieces.commit()
            self.on_disk += self._in_pieces
            self._in_pieces.clear()
        if self.finished:
            self.pieces.close()

    def finish(self, information: Mapping[str, Any]) -> None:
        """Add the summary, and the bag's metadata, so that rosbag2 can read the file alone."""
        if not self.finished:
            self._writer.add_metadata('rosbag2', {'serialized_metadata': to_yaml(information)})
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._count_chunk()
            self.finished = True
