"""A file that grows by whole pieces, even if its disk fills up or its folder is removed."""

from __future__ import annotations

import os
from contextlib import suppress
from typing import TYPE_CHECKING

try:
    import fcntl
except ModuleNotFoundError:  # Windows has no way to see that a file is being written
    fcntl = None  # type: ignore[assignment]

from barc_sim.cli.files import open_regular

if TYPE_CHECKING:
    from pathlib import Path

_COPIED_AT_ONCE = 1 << 20


class Pieces:
    """A stream that collects a piece in memory, and appends it to a file, whole or not at all.

    If `commit` fails, the file is as before, the piece is kept, and `commit` can be tried again.

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
        self._position = 0  # of the stream, with what waits
        self._descriptor = self._open()

    def _open(self) -> int:
        # Windows has no O_CLOEXEC, and would change line ends without O_BINARY.
        system = getattr(os, 'O_CLOEXEC', 0) | getattr(os, 'O_BINARY', 0)
        descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_EXCL | system, 0o666)
        if fcntl:
            with suppress(OSError):  # some file systems cannot
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return descriptor

    def write(self, data: bytes) -> int:
        """Append to the piece."""
        self._waiting.append(data)
        self._position += len(data)
        return len(data)

    def tell(self) -> int:
        """Return the length of all that was written to the stream [B]."""
        return self._position

    def flush(self) -> None:
        """Do nothing: only `commit` ends a piece."""

    @property
    def waiting(self) -> bool:
        """Whether there is a piece to commit."""
        return bool(self._waiting)

    def commit(self) -> None:
        """Append the piece to the file.

        Raises
        ------
        OSError
            The system refused.
        """
        piece = memoryview(b''.join(self._waiting))
        self._waiting = [bytes(piece)] if len(self._waiting) > 1 else self._waiting
        try:
            self._put(piece)
        except OSError:
            os.ftruncate(self._descriptor, self._size)
            raise
        self._size += len(piece)
        self._waiting = []

    def _put(self, data: memoryview) -> None:
        offset = self._size
        while data:
            written = write_at(self._descriptor, data, offset)
            data = data[written:]
            offset += written

    @property
    def in_place(self) -> bool:
        """Whether the file is still where it was made."""
        try:
            found = self._path.stat()
        except OSError:
            return False
        own = os.fstat(self._descriptor)
        return (found.st_dev, found.st_ino) == (own.st_dev, own.st_ino)

    def restore(self) -> None:
        """Make the file and its folder anew, after they were removed.

        Raises
        ------
        OSError
            They cannot be made, or another file has taken the name.
        """
        self._path.parent.mkdir(parents=True, exist_ok=True)
        removed, self._descriptor = self._descriptor, self._open()
        size, self._size = self._size, 0
        os.lseek(removed, 0, os.SEEK_SET)
        while self._size < size:
            part = os.read(removed, min(_COPIED_AT_ONCE, size - self._size))
            self._put(memoryview(part))
            self._size += len(part)
        os.close(removed)

    def close(self) -> None:
        """Close the file; a piece that was not committed is dropped."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


def write_at(descriptor: int, data: memoryview, offset: int) -> int:
    """Do what `os.pwrite` does, which Windows lacks."""
    os.lseek(descriptor, offset, os.SEEK_SET)
    return os.write(descriptor, data)


def is_being_written(path: Path) -> bool:
    """Return whether any process is writing the file by pieces now."""
    if not fcntl:
        return False
    try:
        with open_regular(path, follow=False) as stream:
            fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False
