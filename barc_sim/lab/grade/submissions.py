"""Finds and reads submissions.

No name, link or size in them is trusted. Archives are read in this process, by Python's own
zipfile, within bounds on what it reads at once.
"""

from __future__ import annotations

import io
import os
import stat
import zipfile
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.cli.files import open_regular
from barc_sim.errors import UserError, escaped, one_line
from barc_sim.lab.files import FILES, names_of

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator

#: What is handed in beside code, and not read to grade it: plots, films, pages, bags, archives.
_EVIDENCE = (
    *('.png', '.jpg', '.jpeg', '.gif', '.svg', '.pdf', '.html', '.mp4', '.mkv', '.mov', '.webm'),
    *('.mcap', '.db3', '.bag', '.zip', '.tar.gz'),
)
MAX_FILE = 1 << 20  #: bytes
MAX_FILES = 200
MAX_TOTAL = 8 << 20  #: bytes
_MAX_PATH = 200  # bytes of a file's path: any file system holds it
_MAX_NOTES = 10
MAX_ARCHIVE = 256 << 20  #: bytes
MAX_ENTRIES = 2000  #: files of an archive
# Bytes of it at once: more than a file, and than a directory of so many entries.
_MAX_READ = 2 << 20


class Member(NamedTuple):
    """A file of a submission."""

    path: str  #: in its folder or archive, with slashes
    read: Callable[[int], bytes]  #: returns so many bytes at most
    fault: str = ''  #: why it is not read, as the rest of a sentence


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


def graded(names: Collection[str]) -> list[str]:
    """Return the names of the graded files among those of a folder."""
    return [*names_of(names).values()]


def find(path: Path) -> list[Path]:
    """Return the submissions at `path`: itself, or each entry of the folder, by name.

    What is no folder and no archive is one, too, so that nothing handed in is overlooked; hidden
    files are not. Only `path` itself may be a link, because the grader has typed it.
    """
    if path.exists() and not path.is_dir() and is_archive(path):
        return [path.resolve()]
    if not path.is_dir():
        raise UserError(
            f'there is no folder {str(path)!r}: name one submission, or a folder of them'
        )
    found = sorted(entry for entry in path.iterdir() if not entry.name.startswith(('.', '__')))
    several = any(entry.is_dir() or is_archive(entry) for entry in found)
    names = [entry.name for entry in found]
    if graded(names) if not several else any(name in names for name in FILES.values()):
        return [path.resolve()]
    if not several:
        raise UserError(
            f'{str(path)!r} is no submission and holds none: expected '
            f'{" or ".join(FILES.values())} in it, or a folder for each submission'
        )
    return found


def read(path: Path) -> Submission:
    """Read the submission at `path`; its notes name all that cannot be read."""
    files: dict[str, bytes] = {}
    notes: list[str] = []
    try:
        if fault := _unreadable(path):
            notes.append(fault)
        elif not (
            take(listed(path), files, notes) if path.is_dir() else _unpack(path, files, notes)
        ):
            notes.append('it is empty')
    except Exception as error:  # noqa: BLE001 (a submission decides what opening it raises)
        notes.append(f'it cannot be read: {_reason(error)}')
    if len(notes) > _MAX_NOTES:
        notes[_MAX_NOTES:] = [f'and {len(notes) - _MAX_NOTES} more']
    return Submission(escaped(path.name), files, tuple(notes))


def _unreadable(path: Path) -> str:
    """Return why a submission is not opened; empty for a folder or an archive."""
    status = path.lstat()
    if path.is_dir() and not path.is_symlink():
        return ''
    if fault := _fault_of(status.st_mode):
        return f'it {fault}: hand in a .zip or a folder'
    if not is_archive(path):
        return f'a single {path.suffix} file cannot be graded: hand in a .zip or a folder'
    too_big = f'it has more than {MAX_ARCHIVE >> 20} MiB: hand in a smaller one'
    return too_big if status.st_size > MAX_ARCHIVE else ''


def is_archive(path: Path) -> bool:
    """Return whether the name of `path` is one of an archive that can be opened."""
    return path.name.lower().endswith('.zip')


class _Bounded(io.FileIO):
    """A file of which no reader gets much at once, such as a directory of a million entries."""

    def read(self, size: int | None = -1, /) -> bytes:
        """Return at most `size` bytes."""
        more = _MAX_READ + 1
        data = super().read(more if size is None or size < 0 else min(size, more))
        if len(data) == more:
            raise OverflowError(f'it holds more than {MAX_ENTRIES} files')
        return data


def _unpack(path: Path, files: dict[str, bytes], notes: list[str]) -> int:
    """Take the files of an archive; of a damaged one, reading it can raise any exception."""
    with (
        open_regular(path, follow=False) as file,
        _Bounded(file.fileno(), closefd=False) as bounded,
        zipfile.ZipFile(bounded) as archive,
    ):
        infos = [info for info in archive.infolist() if not info.is_dir()]
        if len(infos) > MAX_ENTRIES:
            raise OverflowError(f'it holds more than {MAX_ENTRIES} files')
        members = [_zipped(archive, info) for info in infos]
        return take(_from_the_graded(members, notes), files, notes)


def _zipped(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Member:
    """Return a member of an archive; those of uncommon methods could take any memory."""

    def content(size: int) -> bytes:
        with archive.open(info) as file:
            return file.read(size)

    kind = stat.S_IFMT(info.external_attr >> 16) or stat.S_IFREG
    fault = _fault_of(kind)
    if not fault and info.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
        fault = 'is packed in an uncommon way: hand in an ordinary .zip'
    # Some of Windows write backslashes.
    return Member(info.filename.replace('\\', '/'), content, fault)


def take(members: Iterable[Member], files: dict[str, bytes], notes: list[str]) -> int:
    """Add the members that a folder can hold to `files`, and notes on the others.

    Return how many there are. Plots, films and bags are left out, of any size.
    """
    seen = 0
    folders = {str(parent) for name in files for parent in PurePosixPath(name).parents}
    for seen, member in enumerate(members, 1):  # noqa: B007 (counted)
        if is_evidence(member.path):
            continue
        if len(files) >= MAX_FILES or sum(map(len, files.values())) > MAX_TOTAL:
            notes.append(f'more than {MAX_FILES} files or {MAX_TOTAL >> 20} MiB: the rest is out')
            break
        name = one_line(member.path, _MAX_PATH)
        parents = [str(parent) for parent in PurePosixPath(member.path).parents]
        if fault := _fault(member, files, folders, parents):
            notes.append(f'{name} {fault}')
            continue
        try:
            data = member.read(MAX_FILE + 1)
        except Exception as error:  # noqa: BLE001 (a damaged file can raise any)
            notes.append(f'{name} cannot be read: {_reason(error)}')
            continue
        if len(data) > MAX_FILE:
            notes.append(f'{name} has more than {MAX_FILE >> 20} MiB')
            continue
        files[member.path] = data
        folders.update(parents)
    return seen


def _fault_of(mode: int) -> str:
    """Return why a file of this mode is not read, as the rest of a sentence; empty if it is."""
    if stat.S_ISLNK(mode):
        return 'is a link, which is not followed'
    return '' if stat.S_ISREG(mode) else 'is no regular file'


def is_evidence(path: str) -> bool:
    """Return whether a file is no part of the code, by its name."""
    return path.lower().endswith(_EVIDENCE) or PurePosixPath(path).name == 'metadata.yaml'


def _fault(member: Member, files: dict[str, bytes], folders: set[str], parents: list[str]) -> str:
    """Return why a file cannot be taken, as the rest of a sentence; empty if it can."""
    path = PurePosixPath(member.path)
    if path.is_absolute() or '..' in path.parts:
        return 'leads out of the archive'
    if '\0' in member.path or not 0 < len(os.fsencode(path)) <= _MAX_PATH:
        return f'has a name that no file can have: at most {_MAX_PATH} bytes'
    if member.path in {*files, *folders} or any(parent in files for parent in parents):
        return 'is there twice: the first is taken'
    return member.fault


def _reason(error: Exception) -> str:
    return escaped(getattr(error, 'strerror', None) or str(error) or type(error).__name__)


def listed(folder: Path) -> Iterator[Member]:
    """Yield the files of a folder, those at its top first."""
    for directory, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not _of_tools(name))
        links = [name for name in folders if Path(directory, name).is_symlink()]
        for name in sorted([*names, *links]):
            path = Path(directory, name)
            if not name.startswith('.'):
                fault = _fault_of(path.lstat().st_mode)
                yield Member(path.relative_to(folder).as_posix(), partial(_data, path), fault)


def _of_tools(name: str) -> bool:
    return name.startswith(('.', '__pycache__', '__MACOSX'))


def _data(path: Path, size: int) -> bytes:
    """Return at most `size` bytes of a regular file."""
    with open_regular(path, follow=False) as file:
        return file.read(size)


def _from_the_graded(members: list[Member], notes: list[str]) -> Iterator[Member]:
    """Yield the files in the folder of the first graded file, and below."""
    folders: dict[PurePosixPath, list[str]] = {}
    for path in (PurePosixPath(member.path) for member in members):
        if not any(map(_of_tools, path.parts)):
            folders.setdefault(path.parent, []).append(path.name)
    copies = {folder: names for folder, all_ in folders.items() if (names := graded(all_))}
    top = min(copies, key=lambda folder: len(folder.parts), default=PurePosixPath())
    notes += [
        f'{escaped(str(folder / name))} is not graded: {escaped(str(top / copies[top][0]))} comes '
        'first'
        for folder, names in copies.items()
        for name in names
        if folder != top
    ]
    for member in members:
        path = PurePosixPath(member.path)
        if '..' in path.parts or path.is_absolute():
            yield member
        elif top in path.parents and not any(map(_of_tools, path.relative_to(top).parts)):
            yield member._replace(path=path.relative_to(top).as_posix())
