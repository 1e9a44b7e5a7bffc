"""Writes a rosbag2 bag: a directory with one or more MCAP files and their metadata.yaml."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from itertools import chain
from typing import TYPE_CHECKING, Any

from barc_sim.bags.mcap_writer import McapFileWriter
from barc_sim.bags.metadata import METADATA_NAME, information, write_metadata
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from barc_sim.bags.file_format import FileFormat
    from barc_sim.bags.messages import MessageFields, Topic


class BagWriter:
    """Writes a bag into an empty directory; not to be shared among threads.

    Messages reach a file in chunks of 768 KiB, each with a checksum, and at `flush`. A file that is
    full, or that `split` ends, gets its summary, and the next one begins; each has the run's
    metadata. `close` writes metadata.yaml. A directory without it holds the bag of a killed run,
    which lacks only the last chunk and the end of the last file.

    A method that raises OSError loses nothing: the data is kept, and `flush` tries again. A file is
    made once the last one is whole.

    Parameters
    ----------
    directory
        Where to write; its files are named after it, as in rosbag2.
    metadata
        The run's own metadata, stored in the files and in `custom_data` of metadata.yaml.
    file_format
        Compression, checksums and chunks of the files.
    max_size
        Size [B] at which a file is full, except its last chunk and its summary; 0: never.
    max_duration
        Time [s] from a file's first message to the last one that it takes; 0: any.

    Raises
    ------
    UserError
        The first file exists or cannot be made.
    """

    def __init__(
        self,
        directory: Path,
        *,
        metadata: Mapping[str, str] | None = None,
        file_format: FileFormat | None = None,
        max_size: int = 0,
        max_duration: float = 0.0,
    ) -> None:
        self.directory = directory
        self.closed = False
        self._metadata = dict(metadata or {})
        self._format = file_format
        self._max_size = max_size
        self._max_duration = round(max_duration * 1e9)

        self._files: list[McapFileWriter] = []
        self._unfinished: list[McapFileWriter] = []  # whose data is not all on the disk
        #: What readers found in truncated files, by name and size.
        self._remaining: dict[tuple[str, int], dict[str, int]] = {}
        self._begin_file()
        try:
            self._commit()
        except OSError as error:
            raise UserError(
                f'the bag {str(self.file)!r} cannot be made ({error.strerror}): name another folder'
            ) from error

    @property
    def _file(self) -> McapFileWriter:
        """The file that takes messages."""
        return self._files[-1]

    @property
    def file(self) -> Path:
        """The path of the file that takes messages."""
        return self._file.path

    @property
    def files(self) -> list[Path]:
        """The paths of all files, in order."""
        return [file.path for file in self._files]

    @property
    def in_place(self) -> bool:
        """Whether the files that are written to are still where they were made."""
        return all(file.in_place for file in self._unfinished)

    @property
    def removed(self) -> list[Path]:
        """The paths of the files that are no longer where they were made."""
        return [file.path for file in self._files if not file.in_place]

    @property
    def is_whole(self) -> bool:
        """Whether the files that are written to have the size that was written."""
        return all(file.is_whole for file in self._unfinished)

    @property
    def on_disk(self) -> dict[str, int]:
        """The number of messages in the files that are still where they were made, by topic.

        In a file that another process has truncated, those of the chunks that are left.
        """
        counts: Counter[str] = Counter()
        for file in self._files:
            with suppress(OSError):  # it was removed meanwhile
                if file.in_place:
                    counts.update(self._read(file) if file.is_truncated else file.committed)
        return dict(counts)

    def _read(self, file: McapFileWriter) -> dict[str, int]:
        """Return the number of messages that can be read in a truncated file, by topic."""
        from barc_sim.bags.contents import Contents  # noqa: PLC0415 (rarely needed)

        state = file.path.name, file.size_on_disk
        if state not in self._remaining:
            counts: Counter[str] = Counter()
            with suppress(UserError):
                counts.update(each.topic.name for each in Contents(file.path).messages())
            self._remaining[state] = dict(counts)
        return self._remaining[state]

    @property
    def counts(self) -> dict[str, int]:
        """The number of messages in finished chunks, by topic."""
        counts: Counter[str] = Counter()
        for file in self._files:
            for topic, count in file.topics:
                counts[topic.name] += count
        return dict(counts)

    def add_metadata(self, entries: Mapping[str, str]) -> None:
        """Add metadata of the run; an entry replaces one of the same name."""
        self._metadata.update(entries)
        if entries:
            self._file.put_metadata(METADATA_NAME, entries)
        self.flush()

    def attach(self, files: Mapping[str, bytes]) -> None:
        """Attach text files, by name."""
        for name, data in files.items():
            self._file.attach(name, data)
        self.flush()

    def write(self, messages: Iterable[MessageFields]) -> None:
        """Append messages, and split the bag where a file is full."""
        remaining = iter(messages)
        excess = self._file.write(remaining)
        while excess is not None:
            self._next_file()
            with suppress(OSError):  # the last line tries again
                self._commit()
            excess = self._file.write(chain([excess], remaining))
        self._commit()

    def split(self) -> None:
        """Finish the file and begin the next one."""
        self._next_file()
        self._commit()

    def flush(self) -> None:
        """Hand all data to the operating system: then a killed process loses nothing."""
        self._file.end_chunk()
        self._commit()

    def close(self) -> None:
        """Finish the bag and write metadata.yaml; a second call does nothing."""
        if self.closed:
            return
        try:
            self._file.finish(self._metadata)
            self._commit()
            write_metadata(self.directory, self._information())
        finally:
            self.closed = True
            for file in self._unfinished:
                file.close()

    def _information(self) -> dict[str, Any]:
        """Return the content of metadata.yaml, which lists the files that are in place."""
        files = [file for file in self._files if file.in_place]
        return information(
            [(file.path.name, file.span) for file in files],
            _merged(chain.from_iterable(file.topics for file in files)),
            self._metadata,
        )

    def _begin_file(self) -> None:
        """Begin the next file, which `_commit` makes."""
        name = f'{self.directory.absolute().name}_{len(self._files)}.mcap'
        file = McapFileWriter(
            self.directory / name,
            self._format,
            max_size=self._max_size,
            max_duration=self._max_duration,
        )
        if self._metadata:
            file.put_metadata(METADATA_NAME, self._metadata)
        self._files.append(file)
        self._unfinished.append(file)

    def _next_file(self) -> None:
        """Finish the file and begin the next one, both of which `_commit` writes."""
        self._file.finish(self._metadata)
        self._begin_file()

    def _commit(self) -> None:
        """Write what is finished, file by file."""
        for file in self._unfinished.copy():
            file.commit()
            if file is not self._file:
                file.close()
                self._unfinished.remove(file)


def _merged(counted: Iterable[tuple[Topic, int]]) -> list[tuple[Topic, int]]:
    """Return the topics, each once, with the sum of their numbers of messages."""
    topics: list[Topic] = []
    equal: dict[int, Topic] = {}  # the first equal topic, by the identity of each
    sums: Counter[int] = Counter()
    for topic, count in counted:
        if id(topic) not in equal:
            equal[id(topic)] = next((other for other in topics if other == topic), topic)
            if equal[id(topic)] is topic:
                topics.append(topic)
        sums[id(equal[id(topic)])] += count
    return [(topic, sums[id(topic)]) for topic in topics]
