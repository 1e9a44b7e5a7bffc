"""Appends blocks to a new file, each whole or not at all."""

from __future__ import annotations

import errno
import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

CHANGED = 'another process has changed its file'


class AtomicAppender:
    """Collects a block in memory, and appends it to a new file, whole or not at all.

    If `commit` fails, the file is as before, the block is kept, and `commit` can be tried again. It
    fails for good once another process has changed the file's size.

    Parameters
    ----------
    path
        The file to make.

    Raises
    ------
    OSError
        The file exists or cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._waiting: list[bytes] = []
        self._size = 0  # of the file
        self.position = 0  #: [B] the length of the file with the block
        # In this mode a file that another process has truncated gets no hole.
        self._file = open(path, 'xb', buffering=0, opener=_open_to_append)  # noqa: SIM115
        self._status = os.fstat(self._file.fileno())

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
        if not self.is_whole:
            raise OSError(errno.ESTALE, CHANGED)
        try:
            self.put(block)
        except OSError:
            self._file.truncate(self._size)
            raise
        self._size += len(block)
        self._waiting = []

    def put(self, data: bytes) -> None:
        """Write to the end of the file, in as many parts as the system needs."""
        rest = memoryview(data)
        while rest:
            written = self._file.write(rest)
            rest = rest[written:]

    @property
    def in_place(self) -> bool:
        """Whether the file is still where it was made, also after `close`."""
        try:
            return os.path.samestat(self._path.stat(), self._status)
        except OSError:
            return False

    @property
    def size_on_disk(self) -> int:
        """The size of the file [B], which another process can have changed."""
        return self._path.stat().st_size

    @property
    def is_whole(self) -> bool:
        """Whether the file has the size that was written."""
        return os.fstat(self._file.fileno()).st_size == self._size

    def close(self) -> None:
        """Close the file; a block that was not committed is dropped."""
        self._file.close()


def _open_to_append(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_APPEND, 0o666)
