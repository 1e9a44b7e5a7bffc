"""Makes a whole bag of a damaged one."""

from __future__ import annotations

import os
import shutil
from collections import Counter
from contextlib import closing
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from barc_sim.bags.contents import Contents
from barc_sim.bags.directory import make_directory
from barc_sim.bags.mcap_files import McapFile
from barc_sim.bags.mcap_writer import McapFileWriter
from barc_sim.bags.metadata import METADATA_NAME, Span, information, write_metadata
from barc_sim.cli.files import open_regular
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from barc_sim.bags.bag_files import BagFile, Damage
    from barc_sim.bags.messages import Topic

_RESERVE = 64 << 20  # [B] that a copy leaves free on its disk


@dataclass
class Recovery:
    """A bag that `recover` has made."""

    damages: dict[str, Damage] = field(default_factory=dict)  #: of the damaged bag, by file
    linked: int = 0  #: number of files that are hard links of whole files
    copied: int = 0  #: number of files that are copies of whole files
    counted: list[tuple[Topic, int]] = field(default_factory=list)  #: messages by topic
    span: Span = field(default_factory=Span)


def recover(path: Path, output: Path) -> Recovery:
    """Make a whole bag of the readable messages of a bag.

    Damaged files are written anew, in MCAP, with schemas, channels and encodings as they were read;
    and so is each file of sqlite3, each compressed one, and the only file of a bag. Other whole
    files are kept: the new bag has hard links of them, or else copies. They are read to the end,
    and their checksum is compared, but they are not unpacked if they have one.

    Parameters
    ----------
    path
        The bag.
    output
        The directory to make.

    Returns
    -------
    Recovery
        What was read, with its damages.

    Raises
    ------
    UserError
        There is no bag, nothing in it can be read, or the output exists or cannot be written.
    """
    contents = Contents(path, timed=True)
    make_directory(output, output.parent)
    try:
        return _Recoverer(contents, output).run()
    except (OSError, UserError) as error:
        shutil.rmtree(output)
        if isinstance(error, UserError):
            raise
        raise UserError(
            f'{str(output)!r} cannot be written ({error.strerror}): name an --output on a disk '
            'with space'
        ) from error


class _Recoverer:
    """Makes the files of the new bag, and its metadata.yaml."""

    def __init__(self, contents: Contents, output: Path) -> None:
        self._contents = contents
        self._output = output
        self._recovery = Recovery()
        self._written: list[tuple[str, Span]] = []  # names of the files
        self._counts: Counter[int] = Counter()  # of messages, by identity of the topic

    def run(self) -> Recovery:
        """Make the bag."""
        is_split = len(self._contents.files) > 1
        for file in self._contents.files:
            if is_split and isinstance(file, McapFile) and file.is_whole():
                self._keep(file)
            else:
                self._rewrite(file)

        if not self._written:
            raise UserError(
                f'{str(self._contents.path)!r} has no message that can be read: name another bag'
            )

        topics = [topic for topic in self._contents.topics if id(topic) in self._counts]
        counted = [(topic, self._counts[id(topic)]) for topic in topics]
        about = information(self._written, counted, self._contents.metadata)
        write_metadata(self._output, about)

        self._recovery.damages = self._contents.damages
        self._recovery.counted = sorted(counted, key=lambda pair: pair[0].name)
        self._recovery.span = sum((span for _, span in self._written), Span())
        return self._recovery

    def _target(self) -> Path:
        """Return the path of the next file."""
        return self._output / f'{self._output.absolute().name}_{len(self._written)}.mcap'

    def _add(self, file: Path, span: Span, counted: Iterable[tuple[Topic, int]]) -> None:
        """Add a file of the new bag."""
        self._written.append((file.name, span))
        for topic, count in counted:
            self._counts[id(topic)] += count

    def _keep(self, file: McapFile) -> None:
        """Give a whole file a name in the new bag, or copy it to another disk."""
        target = self._target()
        try:
            os.link(file.path, target, follow_symlinks=False)
        except (OSError, NotImplementedError):  # the latter on Windows
            self._copy(file.path, target)
            self._recovery.copied += 1
        else:
            self._recovery.linked += 1
        self._add(target, file.span, file.counted)

    def _copy(self, source: Path, target: Path) -> None:
        free = shutil.disk_usage(self._output).free
        if free < source.lstat().st_size + _RESERVE:
            raise UserError(
                f'{str(source)!r} cannot be copied to {str(self._output)!r}, as only '
                f'{free >> 20} MiB are free: name an --output on the disk of the bag, or on a '
                'larger one'
            )
        with open_regular(source, follow=False) as stream, target.open('xb') as copy:
            shutil.copyfileobj(stream, copy, 1 << 20)

    def _rewrite(self, file: BagFile) -> None:
        """Write the readable messages of a file to a new one; there is none without any."""
        metadata = self._contents.metadata
        with closing(McapFileWriter(self._target())) as writer:
            if metadata:
                writer.put_metadata(METADATA_NAME, metadata)
            for name in file.attachment_names:
                writer.attach(name, self._contents.attachments[name])
            writer.commit()
            for message in self._contents.messages_of(file):
                writer.write(iter([message]))
                writer.commit()

            is_only_file = len(self._contents.files) == 1
            has_content = bool(writer.topics or file.attachment_names)
            if has_content or is_only_file:
                writer.finish(metadata)
                writer.commit()
                self._add(writer.path, writer.span, writer.topics)
            else:
                writer.path.unlink()
