"""The files of a bag, in order.

A recorder splits a bag into several files, and can compress each of them. metadata.yaml names the
files. The bag of a killed recorder may lack it, or it may not name the last file.
"""

from __future__ import annotations

import os
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import PureWindowsPath
from textwrap import dedent
from typing import TYPE_CHECKING, BinaryIO, NamedTuple, Protocol, cast

import zstandard

from barc_sim.cli.files import decoded, open_regular, read_regular
from barc_sim.cli.yaml_files import from_yaml
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Sequence
    from pathlib import Path

    from mcap.records import Channel, Schema

    from barc_sim.bags.messages import BagMessage, Topic
    from barc_sim.bags.metadata import Span

MCAP = '.mcap'  #: suffix of a file in MCAP
SQLITE = '.db3'  #: suffix of a database of sqlite3
COMPRESSED = '.zstd'  #: what rosbag2 adds to the name of a file that it has compressed
_SIDE_SUFFIXES = ('-wal', '-journal')
_MAX_METADATA = 16 << 20  # bytes of metadata.yaml
#: An entry of metadata.yaml: its line, and all lines that are empty, are indented more, or begin
#: with the `-` of a list.
_ENTRY = r'^( *){name}:.*\n?(?:\n|\1[ -].*\n?)*'


def files(path: Path) -> list[Path]:
    """Return the files of a bag, in order: those that metadata.yaml names, then others by number.

    A file that metadata.yaml does not name belongs to a recorder that was killed. Where a folder
    has a file both compressed and not, one of them is unfinished: the file that metadata.yaml names
    is read, or else the one that is not compressed, which rosbag2 removes at the end.

    Parameters
    ----------
    path
        The bag's directory, or one of its files, which is then the only one.

    Raises
    ------
    UserError
        There is no bag at `path`.
    """
    if not path.exists():
        raise UserError(f'there is no bag {str(path)!r}: name the directory of a bag')
    if not path.is_dir():
        return [path.resolve() if path.is_symlink() else path]

    present = [file for file in path.iterdir() if suffix_of(file) and file.name[0] != '.']
    if not present:
        raise UserError(
            f'{str(path)!r} has no {MCAP} and no {SQLITE} file in it: name the directory of a bag'
        )
    if len(present) == 1:
        return present
    return _in_order(present, _names_in_metadata(path))


def suffix_of(file: Path) -> str:
    """Return which kind of storage a file's name states, `.mcap` or `.db3`; empty: none."""
    name = file.name.removesuffix(COMPRESSED)
    return next((suffix for suffix in (MCAP, SQLITE) if name.endswith(suffix)), '')


def _in_order(present: list[Path], names: list[str]) -> list[Path]:
    """Return the files of one storage, each once."""
    places = {name: place for place, name in enumerate(names)}
    named = [file for file in present if file.name in places]
    suffixes = {suffix_of(file) for file in named or present}
    suffix = MCAP if MCAP in suffixes else SQLITE

    # By name without compression. The last file of a name counts: one that is named, or else the
    # one that is not compressed.
    chosen: dict[str, Path] = {}
    for file in sorted(present, key=lambda file: (file.name in places, -len(file.name))):
        if suffix_of(file) == suffix:
            chosen[file.name.removesuffix(COMPRESSED)] = file

    def place(file: Path) -> tuple[int, int, str]:
        return places.get(file.name, len(places)), _number(file), file.name

    return sorted(chosen.values(), key=place)


def _number(file: Path) -> int:
    """Return the number in a file's name, such as 10 in run_10.mcap; -1: it has none."""
    number = re.search(r'_(\d+)\.', file.name)
    return int(number[1]) if number else -1


def _names_in_metadata(directory: Path) -> list[str]:
    """Return the names of files in metadata.yaml, without folders; none if it cannot be read.

    Recorders up to Foxy wrote the name of the folder before it, or the whole path.
    """
    names = _entry_of_metadata(directory, 'relative_file_paths')
    if not isinstance(names, list):
        return []
    return [PureWindowsPath(str(name)).name for name in names]


def custom_data(path: Path) -> dict[str, str]:
    """Return what the user of rosbag2 has added to metadata.yaml; nothing if it cannot be read.

    Parameters
    ----------
    path
        The bag's directory, or one of its files, which has none.
    """
    entries = _entry_of_metadata(path, 'custom_data')
    if not isinstance(entries, dict):
        return {}
    return {str(name): str(text) for name, text in entries.items()}


def _entry_of_metadata(directory: Path, name: str) -> object:
    """Return an entry of metadata.yaml, without the others, which can be long; None: unreadable."""
    with suppress(OSError, UserError, ValueError, LookupError, TypeError):
        data = read_regular(directory / 'metadata.yaml', _MAX_METADATA, follow=False)
        entry = re.search(_ENTRY.format(name=name), decoded(data), re.MULTILINE)
        if entry:
            value: object = from_yaml(dedent(entry[0]))[name]
            return value
    return None


def side_files(file: Path) -> list[Path]:
    """Return what a killed recorder left beside a database: its write-ahead log, its journal.

    rosbag2 also leaves empty ones, which change nothing.
    """
    if suffix_of(file) != SQLITE:
        return []
    beside = [file.with_name(file.name + suffix) for suffix in _SIDE_SUFFIXES]
    return [each for each in beside if each.is_file() and each.lstat().st_size > 0]


class OpenFile(NamedTuple):
    """A file of a bag that is open for reading."""

    stream: BinaryIO
    size: int  #: [B] on the disk


def open_storage(file: Path) -> OpenFile:
    """Open a file of a bag for reading; a compressed file is unpacked as it is read.

    Raises
    ------
    UserError
        It is no regular file, or cannot be read.
    """
    try:
        stream = open_regular(file, follow=False)
    except OSError as error:
        raise UserError(
            f'{str(file)!r} cannot be read ({error.strerror}): name another bag'
        ) from error
    size = os.fstat(stream.fileno()).st_size
    if is_compressed(file):
        # The window, which decides how much memory is used, is at most 128 MiB.
        decompressor = zstandard.ZstdDecompressor()
        stream = cast('BinaryIO', decompressor.stream_reader(stream, read_across_frames=True))
    return OpenFile(stream, size)


def is_compressed(file: Path) -> bool:
    """Return whether rosbag2 has compressed the whole file."""
    return file.suffix == COMPRESSED


@dataclass
class Damage:
    """The damage found in a file."""

    unreadable_chunks: int = 0
    unfinished: bool = False  #: its end is missing
    unread: int = 0  #: [B] after the last whole record

    def __bool__(self) -> bool:
        """Return whether anything is missing."""
        return self.unfinished or self.unreadable_chunks > 0


class FilledContents(Protocol):
    """The contents of a bag, to which its files add; `Contents` is that."""

    metadata: dict[str, str]
    attachments: dict[str, bytes]

    def topic(self, channel: Channel, schema: Schema | None) -> Topic:
        """Return the topic of a channel, the same one for equal channels of all files."""


class BagFile(Protocol):
    """A file of a bag: it adds its topics to the bag at once, and yields its messages."""

    path: Path
    damage: Damage  #: `messages` renews it
    has_summary: bool  #: whether topics and time span are known before the messages are read
    span: Span  #: the time span of all messages; empty if it is unknown

    @property
    def attachment_names(self) -> Sequence[str]:
        """The names of the files that are attached to it."""

    def messages(self, start: int | None = None) -> Iterator[BagMessage]:
        """Yield the messages that were received at `start` [ns] or later, in the file's order."""

    def blocks_before(
        self, end: int, wants: Callable[[Collection[int], int], bool]
    ) -> Iterator[Iterator[BagMessage]]:
        """Yield blocks of messages before a time, as `Contents.blocks_before` does."""
