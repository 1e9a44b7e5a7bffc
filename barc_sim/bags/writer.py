"""Writes a rosbag2 bag: a directory with MCAP files and their metadata.yaml."""

from __future__ import annotations

import time
from collections import Counter
from math import inf
from typing import TYPE_CHECKING, Any

from mcap.records import Attachment

from barc_sim.bags.file import BagFile
from barc_sim.bags.recording import Span, information, write_metadata
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from barc_sim.bags.messages import MessageFields
    from barc_sim.bags.recording import Topic


class BagWriter:
    """Writes a bag into an empty directory; not to be shared among threads.

    Messages reach the file in chunks of 768 KiB, and at `flush`. `close` writes metadata.yaml: a
    directory without it holds a bag whose run was killed, whole but for the last chunk.

    A method that raises OSError loses nothing: the data is kept, and `flush` tries again.

    Parameters
    ----------
    directory
        Where to write; the files in it are named after it, as rosbag2 does.
    metadata
        The run's own, kept in the files and in `custom_data` of metadata.yaml.
    max_size, max_duration
        Of a file [B], [s]: a new one begins after the message that reaches one of them.
    compression
        One of `COMPRESSIONS`.

    Raises
    ------
    UserError
        The file exists or cannot be made.

    Examples
    --------
    >>> from barc_sim.bags import messages, reader
    >>> directory = Path('by_hand')
    >>> directory.mkdir()
    >>> writer = BagWriter(directory, metadata={'command': 'by hand'})
    >>> topic = messages.topic('/ecu', 'barc_interfaces/msg/ECU')
    >>> writer.write([messages.Message(topic, bytes(36), received=0, published=0, number=1)])
    >>> writer.close()
    >>> dict(reader.load(directory).counts)
    {'ecu': 1}
    """

    def __init__(
        self,
        directory: Path,
        *,
        metadata: Mapping[str, str] | None = None,
        max_size: float = inf,
        max_duration: float = inf,
        compression: str = 'zstd',
    ) -> None:
        self.directory = directory
        self._compression = compression
        self._max_size, self._max_span = max_size, max_duration * 1e9
        self._files: list[BagFile] = []
        self._span = Span()  # of the last file, where there are limits
        self._metadata: dict[str, str] = {}
        self.closed = False
        try:
            self._begin_file()
            self.add_metadata(metadata or {})
        except OSError as error:
            path = directory / f'{directory.absolute().name}_0.mcap'
            raise UserError(
                f'the bag {str(path)!r} cannot be made ({error.strerror}): name another folder'
            ) from error

    @property
    def file(self) -> Path:
        """The file that is being written."""
        return self._files[-1].path

    @property
    def counts(self) -> dict[str, int]:
        """The number of messages given to `write` before the last `flush`, by topic."""
        return dict(sum((file.counts for file in self._files), Counter()))

    @property
    def on_disk(self) -> dict[str, int]:
        """The number of messages in the files that are still where they were made, by topic."""
        there = (file for file in self._files if file.appender.in_place)
        return dict(sum((file.on_disk for file in there), Counter()))

    def add_metadata(self, entries: Mapping[str, str]) -> None:
        """Add metadata of the run; an entry replaces one of the same name."""
        self._metadata.update(entries)
        if entries:
            self._files[-1].end_chunk()
            self._files[-1].add_metadata(entries)
        self.flush()

    def attach(self, files: Mapping[str, bytes]) -> None:
        """Attach text files, by name, to the bag's current file."""
        self._files[-1].end_chunk()
        for name, data in files.items():
            # The time of its last change is unknown.
            self._files[-1].attach(Attachment(0, time.time_ns(), name, 'text/plain', data))
        self.flush()

    def write(self, messages: Sequence[MessageFields]) -> None:
        """Append messages; those of one name have the same topic each time."""
        if min(self._max_size, self._max_span) == inf:
            self._files[-1].add(messages)
        else:
            self._write_within_limits(messages)
        self._commit()

    def _write_within_limits(self, messages: Sequence[MessageFields]) -> None:
        failure = None
        for message in messages:
            size, span = self._files[-1].appender.position, self._span.duration
            full = size >= self._max_size or span >= self._max_span
            try:
                if full and not failure:
                    self.split()
            except OSError as error:
                failure = error  # the file continues
            self._files[-1].add([message])
            self._span.add(message[2])
        if failure:
            raise failure

    def split(self) -> None:
        """Continue in the next file."""
        self._files[-1].end_chunk()
        self._begin_file()
        self._files[-2].finish(self._information())
        self._files[-1].add_metadata(self._metadata)
        self._commit()

    def _begin_file(self) -> None:
        name = f'{self.directory.absolute().name}_{len(self._files)}.mcap'
        self._files.append(BagFile(self.directory / name, self._compression))
        self._span = Span()

    def flush(self) -> None:
        """Hand all data to the operating system: a kill of the process loses nothing then."""
        self._files[-1].end_chunk()
        self._commit()

    def _commit(self) -> None:
        for file in self._files:
            file.commit()

    def restore(self) -> bool:
        """Make the current file anew if it was removed; return whether it was."""
        appender = self._files[-1].appender
        removed = not self.closed and not appender.in_place
        if removed:
            appender.restore()
        return removed

    def close(self) -> None:
        """Finish the bag and write metadata.yaml; a second call does nothing."""
        if self.closed:
            return
        try:
            self._files[-1].end_chunk()
            self._files[-1].finish(self._information())
            self._commit()
            write_metadata(self.directory, self._information())
        finally:
            self.closed = True
            for file in self._files:
                file.appender.close()

    def _information(self) -> dict[str, Any]:
        spans = {file.path.name: file.span for file in self._files}
        topics: dict[str, Topic] = {}
        for file in self._files:
            for topic in file.topics.values():
                topics.setdefault(topic.name, topic)
        counts = self.counts
        counted = [(topic, counts[name]) for name, topic in topics.items()]
        return information(spans, counted, self._metadata)
