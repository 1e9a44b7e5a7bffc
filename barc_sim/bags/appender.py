"""Appends blocks to a new file, each whole or not at all."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from io import FileIO
    from pathlib import Path

CHANGED = 'another process has changed its file'


class AtomicAppender:
    """Collects a block in memory, and appends it to a new file, whole or not at all.

    The first `commit` makes the file. If `commit` fails, the file is as before, the block is kept,
    and `commit` can be tried again. It fails for good once another process has changed the file's
    size, or has made the file before.

    Parameters
    ----------
    path
        The file to make.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._waiting: list[bytes] = []
        self._size = 0  # of the file
        self.position = 0  #: [B] the length of the file with the block
        self._file: FileIO | None = None  # once it is made
        self._status: os.stat_result | None = None

    def write(self, data: bytes) -> None:
        """Append to the block."""
        self._waiting.append(data)
        self.position += len(data)

    @property
    def waiting(self) -> bool:
        """Whether there is a block to commit."""
        return bool(self._waiting)

    def commit(self) -> None:
        """Append the block to the file; OSError: that failed, or another process has changed it."""
        block = b''.join(self._waiting)
        self._waiting = [block]
        if self._file is None:
            self._make(block)
        else:
            self._append(self._file, block)
        self._size += len(block)
        self._waiting = []

    def _make(self, block: bytes) -> None:
        """Make the file with its first block, or leave none."""
        # In this mode a file that another process has truncated gets no hole.
        file = open(self._path, 'xb', buffering=0, opener=_open_to_append)  # noqa: SIM115
        try:
            self.put(file, block)
        except OSError:
            file.close()
            with suppress(OSError):
                self._path.unlink()
            raise
        self._file = file
        self._status = os.fstat(file.fileno())

    def _append(self, file: FileIO, block: bytes) -> None:
        if not self.is_whole:
            raise OSError(errno.ESTALE, CHANGED)
        try:
            self.put(file, block)
        except OSError:
            file.truncate(self._size)
            raise

    @staticmethod
    def put(file: FileIO, data: bytes) -> None:
        """Write to the end of a file, in as many parts as the system needs."""
        rest = memoryview(data)
        while rest:
            written = file.write(rest)
            rest = rest[written:]

    @property
    def in_place(self) -> bool:
        """Whether the file is still where it was made, if it was, also after `close`."""
        if self._status is None:
            return True
        try:
            return os.path.samestat(self._path.stat(), self._status)
        except OSError:
            return False

    @property
    def size_on_disk(self) -> int:
        """The size of the file [B], which another process can have changed."""
        return self._path.stat().st_size if self._status else 0

    @property
    def is_whole(self) -> bool:
        """Whether the file has the size that was written."""
        return self._file is None or os.fstat(self._file.fileno()).st_size == self._size

    def close(self) -> None:
        """Close the file; a block that was not committed is dropped."""
        if self._file is not None:
            self._file.close()


def _open_to_append(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_APPEND, 0o666)
