"""Finds and reads submissions; no name, link or size in them is trusted."""

from __future__ import annotations

import os
import stat
import zipfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from barc_sim.errors import UserError
from barc_sim.lab.grade.text import printable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

#: The graded files; a submission has at least one of them.
GRADED = ('bike_model.py', 'controller.py')
MAX_FILE = 1 << 20  #: bytes
MAX_FILES = 200
MAX_TOTAL = 8 << 20  #: bytes

_Content = tuple[str, 'Callable[[], bytes]']


@dataclass(frozen=True)
class Submission:
    """A submission's files, in memory, so that nothing else of its folder can be reached."""

    name: str  #: its folder's or archive's
    files: dict[str, bytes] = field(default_factory=dict)  #: by path in the folder
    notes: tuple[str, ...] = ()  #: on files that were left out

    def write(self, folder: Path) -> None:
        """Write the files into `folder`, which exists."""
        for name, data in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)


def find(path: Path) -> list[Path]:
    """Return the submissions at `path`: itself, or each folder and .zip file in it, by name.

    Only `path` itself may be a link, because the grader has typed it.

    Raises
    ------
    UserError
        if there is none.
    """
    if path.is_file() and path.suffix == '.zip':
        return [path.resolve()]
    if not path.is_dir():
        raise UserError(
            f'there is no folder {str(path)!r}: name one submission, or a folder of them'
        )
    if any((path / name).exists() for name in GRADED):
        return [path.resolve()]
    found = sorted(
        entry
        for entry in path.iterdir()
        if not entry.name.startswith(('.', '__')) and (entry.is_dir() or entry.suffix == '.zip')
    )
    if not found:
        raise UserError(
            f'{str(path)!r} is no submission and holds none: expected {" or ".join(GRADED)} in it, '
            'or a folder for each submission'
        )
    return found


def read(path: Path) -> Submission:
    """Read the submission at `path`; its notes name the files that cannot be read."""
    name = printable(path.resolve().name)
    if path.is_symlink():
        return Submission(name, notes=('the folder is a link, which is not followed',))
    notes: list[str] = []
    files: dict[str, bytes] = {}
    try:
        contents = _zipped(path, notes) if path.is_file() else _listed(path, notes)
        for file, content in contents:
            if len(files) >= MAX_FILES or sum(map(len, files.values())) > MAX_TOTAL:
                notes.append(
                    f'more than {MAX_FILES} files or {MAX_TOTAL >> 20} MiB: the rest is out'
                )
                break
            try:
                data = content()
            except (
                OSError,
                RuntimeError,
                ValueError,
                EOFError,
                zipfile.BadZipFile,
                zlib.error,
            ) as e:
                notes.append(f'{printable(file)} cannot be read: {_reason(e)}')
                continue
            if len(data) > MAX_FILE:
                notes.append(f'{printable(file)} has more than {MAX_FILE >> 20} MiB')
                continue
            files[file] = data
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        notes.append(f'it cannot be read: {_reason(error)}')
    return Submission(name, files, tuple(notes))


def _reason(error: Exception) -> str:
    return printable(getattr(error, 'strerror', None) or str(error) or type(error).__name__)


def _listed(folder: Path, notes: list[str]) -> Iterator[_Content]:
    """Yield the files of a folder, those at its top first."""
    for directory, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith(('.', '__pycache__')))
        for name in sorted(names):
            path = Path(directory, name)
            file = path.relative_to(folder).as_posix()
            if path.is_symlink():
                notes.append(f'{printable(file)} is a link, which is not followed')
            elif not name.startswith('.'):
                yield file, lambda path=path: _data(path)  # type: ignore[misc]


def _data(path: Path) -> bytes:
    """Return the contents of a regular file; one byte beyond the limit if it is too large."""
    # Without waiting for the other end of a named pipe, and without following a link.
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(descriptor, 'rb') as file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError('it is not a regular file')
        return file.read(MAX_FILE + 1)


def _zipped(archive: Path, notes: list[str]) -> Iterator[_Content]:
    """Yield the files of an archive in the folder of its first `GRADED` file, and below."""
    with zipfile.ZipFile(archive) as opened:
        members = [member for member in opened.infolist() if not member.is_dir()]
        tops = [PurePosixPath(m.filename).parent for m in members if _base(m) in GRADED]
        top = min(tops, key=lambda path: len(path.parts), default=PurePosixPath())
        for member in members:
            path = PurePosixPath(member.filename)
            if top not in path.parents:
                continue
            file = path.relative_to(top)
            if file.is_absolute() or '..' in file.parts or stat.S_ISLNK(member.external_attr >> 16):
                notes.append(f'{printable(member.filename)} leads out of the archive')
            elif not any(part.startswith(('.', '__pycache__')) for part in file.parts):
                yield file.as_posix(), lambda member=member: _unzipped(opened, member)  # type: ignore[misc]


def _base(member: zipfile.ZipInfo) -> str:
    return PurePosixPath(member.filename).name


def _unzipped(opened: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    with opened.open(member) as file:
        return file.read(MAX_FILE + 1)
