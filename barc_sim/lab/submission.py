"""Finds and reads submissions: the files of a folder or a .zip, whose contents are not trusted.

Names, links and sizes are checked. The grader itself reads archives, by Python's zipfile, before it
starts a process for the submission; limits hold for how much it reads at once.

The steps from a folder or an archive to a `Submission`:

1. `listed` or `_zipped` yields each file as a `Member`, which is not read yet.
2. `_beside_code` takes the first `MAX_ENTRIES`, without files of tools and without evidence, which
   are the plots, films and bags that are not read for grading.
3. `_in_code_folder` keeps the folder of the graded file that is nearest to the top, and all below
   it. It adds a note on each other copy.
4. `take` reads these within the limits, and adds a note on each one that it leaves out.
5. If no graded file is found, and there is a single archive, the steps repeat for this archive.

A fault is the reason why a file is not read, as the rest of a sentence that begins with its name,
such as "is a link, which is not followed"; empty if there is none.
"""

from __future__ import annotations

import io
import os
import stat
import zipfile
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from pathlib import Path, PurePath, PurePosixPath
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

from barc_sim.cli.files import HeldFolder, open_regular
from barc_sim.cli.text import one_line
from barc_sim.errors import UserError, escaped
from barc_sim.lab.files import FILES, files_in, names_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

_LISTS = ('.csv', '.yml')  # of a class: a roster, the metadata of Gradescope
SUMMARY = 'summary.txt'  #: what `submit` writes about a zip
#: Files beside the code, which are not read for grading: plots, films, pages, bags, archives.
_EVIDENCE = (
    *('.png', '.jpg', '.jpeg', '.gif', '.svg', '.pdf', '.html', '.mp4', '.mkv', '.mov', '.webm'),
    *('.mcap', '.db3', '.bag', '.zip', '.tar.gz', '/metadata.yaml'),
    f'/{SUMMARY}',
)
MAX_FILE = 1 << 20  #: bytes
MAX_FILES = 200
MAX_TOTAL = 8 << 20  #: bytes
MAX_ARCHIVE = 256 << 20  #: bytes of a .zip
MAX_ENTRIES = 2000  #: files of a submission that are considered
_MAX_READ = 4 << 20  # bytes of an archive at once, such as the list of its files
_MAX_DEPTH = 1  # of archives in an archive
_MAX_PATH = 200  # bytes of a file's path: any file system holds it
_MAX_NOTES = 10
_SHOWN = 60  # characters of a file's path


@dataclass(frozen=True)
class Submission:
    """The files of a submission, in memory, so that nothing else of its folder can be reached."""

    name: str  #: of its folder or archive
    files: dict[str, bytes] = field(default_factory=dict)  #: by path in the folder
    notes: tuple[str, ...] = ()  #: on files that were left out

    def write(self, folder: Path) -> None:
        """Write the files into `folder`, which exists."""
        for name, data in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)


def find(path: Path, *, is_class: bool = False) -> list[Path]:
    """Return the submissions at `path`: `path` itself, or the entries of the folder, by name.

    A folder with nothing but a folder of code in it is one submission, unless it `is_class`. In a
    class any other file is a submission, too, so that none is overlooked, except for hidden files
    and lists of the class. Only `path` itself may be a link, because the instructor has typed it.
    """
    if not path.is_dir():
        _check_archive(path)
        return [path.resolve()]

    entries = sorted(entry for entry in path.iterdir() if not entry.name.startswith(('.', '__')))
    packed = [entry for entry in entries if entry.is_dir() or _is_archive(entry.name)]
    if _has_code(entries, packed) or (not is_class and _wraps_code(packed)):
        return [path.resolve()]

    if not packed:
        raise UserError(
            f'{str(path)!r} is not a submission and contains none: expected '
            f'{" or ".join(FILES.values())} in it, or a folder for each submission'
        )
    return [entry for entry in entries if entry in packed or entry.suffix not in _LISTS]


def _check_archive(path: Path) -> None:
    """Check that a path, which is no folder, is that of an archive."""
    if path.exists() and _is_archive(path.name):
        return
    fault = f'{str(path)!r} is a file' if path.exists() else f'there is no folder {str(path)!r}'
    raise UserError(f'{fault}: name one submission (a folder or a .zip), or a folder of them')


def _has_code(entries: Sequence[Path], packed: Sequence[Path]) -> bool:
    """Return whether a folder with these entries has graded files, so that it is one submission.

    Beside folders or archives, which may be a class, only an exact name counts: a file with a
    similar name, such as `controller_solution.py`, can be the instructor's.
    """
    names = [entry.name for entry in entries]
    if packed:
        return any(name in names for name in FILES.values())
    return bool(names_of(names))


def _wraps_code(packed: Sequence[Path]) -> bool:
    """Return whether there is one folder alone, with graded files in it."""
    return len(packed) == 1 and bool(files_in(packed[0]))


def read_submission(path: Path) -> Submission:
    """Read the submission at `path`; its notes name the files that cannot be read."""
    files: dict[str, bytes] = {}
    notes: list[str] = []
    try:
        status = path.lstat()
        if stat.S_ISDIR(status.st_mode):
            with HeldFolder(path) as folder:
                files, notes = _of_folder(folder)
        else:
            fault = _archive_fault(path.name, status)
            if fault:
                notes.append(fault)
            else:
                with open_regular(path, follow=False) as file:
                    files, notes = _of_archive(file)
    except Exception as error:  # noqa: BLE001 (a damaged submission can raise any exception)
        notes.append(f'it cannot be read: {_reason_of(error)}')
    if not files and not notes:
        notes.append('it contains no file to grade')
    if len(notes) > _MAX_NOTES:
        notes[_MAX_NOTES:] = [f'and {len(notes) - _MAX_NOTES} more']
    return Submission(escaped(path.name), files, tuple(notes))


def _archive_fault(name: str, status: os.stat_result) -> str:
    """Return why a file is no archive that can be opened, as a sentence; empty if it is one."""
    fault = _mode_fault(status.st_mode)
    if fault:
        return f'it {fault}: hand in a .zip or a folder'
    if name.lower().endswith('.ipynb'):
        return 'a notebook cannot be graded: hand in its code as a .py file, in a .zip or a folder'
    if not _is_archive(name):
        return f'a single {Path(name).suffix} file cannot be graded: hand in a .zip or a folder'
    if status.st_size > MAX_ARCHIVE:
        return f'it is larger than {MAX_ARCHIVE >> 20} MiB: leave the video out'
    return ''


def _is_archive(name: str) -> bool:
    """Return whether a name ends with .zip."""
    return name.lower().endswith('.zip')


def _of_folder(folder: HeldFolder) -> tuple[dict[str, bytes], list[str]]:
    """Return the files of a folder, or of the only archive in one without code, and notes."""
    files, notes = _beside_code(listed(folder))
    # Moodle packs each student's archive in a folder.
    packed = {name: status for name, status in folder.entries().items() if _is_archive(name)}
    if names_of(files) or len(packed) != 1:
        return files, notes
    name, status = packed.popitem()
    fault = _archive_fault(name, status)
    if fault:
        return {}, [fault]
    with folder.open(PurePath(name)) as file:
        return _of_archive(file)


def _of_archive(file: BinaryIO) -> tuple[dict[str, bytes], list[str]]:
    """Return the files of an archive, and notes; a damaged one can raise any exception."""
    with _Bounded(file.fileno(), closefd=False) as bounded:
        return _unpacked(bounded)


def _unpacked(file: BinaryIO, depth: int = 0) -> tuple[dict[str, bytes], list[str]]:
    """Return the files of an archive, or of the only archive in one without code, and notes."""
    with zipfile.ZipFile(file) as archive:
        members = [_zipped(archive, info) for info in archive.infolist() if not info.is_dir()]
        from_top = sorted(members, key=lambda each: len(PurePosixPath(each.path).parts))
        files, notes = _beside_code(from_top)
        packed = [
            each for each in members if _is_archive(each.path) and not _is_of_tools(each.path)
        ]
        if names_of(files) or len(packed) != 1 or packed[0].fault:
            return files, notes
        data = packed[0].read(_MAX_READ + 1)

    shown = _shown(PurePosixPath(packed[0].path))
    if len(data) > _MAX_READ:
        return {}, [f'{shown} is larger than {_MAX_READ >> 20} MiB: hand in only your own code']
    if depth == _MAX_DEPTH:
        return {}, [f'{shown} is an archive in an archive in an archive: pack your code once']
    return _unpacked(io.BytesIO(data), depth + 1)


def _beside_code(members: Iterable[Member]) -> tuple[dict[str, bytes], list[str]]:
    """Return the files beside the code among members, those nearest to the top first, and notes."""
    candidates = (each for each in members if not _is_left_out(each))
    first = [*islice(candidates, MAX_ENTRIES)]

    beside_code, notes = _in_code_folder(first)
    files, left_out = take(beside_code)
    notebooks = [each.path for each in first if each.path.lower().endswith('.ipynb')]
    if notebooks and not names_of(files):
        shown = _shown(PurePosixPath(notebooks[0]))
        notes.append(f'{shown} is a notebook, which is not graded: hand in its code as a .py file')
    return files, notes + left_out


class Member(NamedTuple):
    """A file of a submission."""

    path: str  #: in its folder or archive, with slashes
    read: Callable[[int], bytes]  #: returns at most so many bytes
    fault: str = ''  #: why it is not read, as the rest of a sentence


def listed(folder: HeldFolder) -> Iterator[Member]:
    """Yield the files of a folder, those nearest to its top first; read them while it is held."""
    folders = [PurePosixPath()]
    for directory in folders:  # the loop adds folders
        try:
            entries = folder.entries(directory)
        except OSError as error:
            if directory == folders[0]:
                raise
            # Unreadable, or exchanged for a link meanwhile.
            yield Member(str(directory), _nothing, f'cannot be read: {_reason_of(error)}')
            continue
        for name, status in sorted(entries.items()):
            if _is_of_tools(name):
                continue
            path = directory / name
            if not stat.S_ISDIR(status.st_mode):
                yield Member(str(path), partial(_data, folder, path), _mode_fault(status.st_mode))
            elif len(folders) < MAX_ENTRIES and len(os.fsencode(path)) < _MAX_PATH:
                folders.append(path)


def _data(folder: HeldFolder, path: PurePosixPath, size: int) -> bytes:
    """Return at most `size` bytes of a regular file."""
    with folder.open(path) as file:
        return file.read(size)


def _nothing(_: int) -> bytes:
    return b''


class _Bounded(io.FileIO):
    """A file that refuses to read much at once, such as an archive's list of a million files."""

    def read(self, size: int | None = -1, /) -> bytes:
        """Return at most `size` bytes."""
        more = _MAX_READ + 1
        data = super().read(more if size is None or size < 0 else min(size, more))
        if len(data) == more:
            raise OverflowError('it contains too many files: hand in only your own code')
        return data


def _zipped(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Member:
    """Return a member of an archive; uncommon compression could need any memory."""

    def content(size: int) -> bytes:
        with archive.open(info) as file:
            return file.read(size)

    fault = _mode_fault(stat.S_IFMT(info.external_attr >> 16) or stat.S_IFREG)
    if not fault and info.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
        fault = 'is compressed in an uncommon way: hand in an ordinary .zip'
    # Some programs on Windows write backslashes.
    return Member(info.filename.replace('\\', '/'), content, fault)


def _in_code_folder(members: Sequence[Member]) -> tuple[list[Member], list[str]]:
    """Return the files in the folder of the first graded file, and below; and notes on copies."""
    folders: dict[PurePosixPath, list[str]] = {}
    for path in (PurePosixPath(member.path) for member in members):
        if not _leads_out(path):
            folders.setdefault(path.parent, []).append(path.name)

    code_files = {}  # the first one of each folder that has one
    for folder, names in folders.items():
        code_names = list(names_of(names).values())
        if code_names:
            code_files[folder] = folder / code_names[0]
    top = min(code_files, key=lambda folder: len(folder.parts), default=PurePosixPath())
    notes = [
        f'{_shown(copy)} is not graded, because {_shown(code_files[top])} is'
        for folder, copy in code_files.items()
        if folder != top
    ]

    beside_code = []
    for member in members:
        path = PurePosixPath(member.path)
        if _leads_out(path):
            beside_code.append(member)  # for its note
        elif top in path.parents:
            beside_code.append(member._replace(path=path.relative_to(top).as_posix()))
    return beside_code, notes


def take(members: Iterable[Member]) -> tuple[dict[str, bytes], list[str]]:
    """Return the members within the limits, by path, and notes on the others.

    Plots, films and bags are left out, without a note.
    """
    files: dict[str, bytes] = {}
    notes: list[str] = []
    for member in members:
        if _is_evidence(member):
            continue
        if len(files) >= MAX_FILES or sum(map(len, files.values())) > MAX_TOTAL:
            limits = f'{MAX_FILES} files or {MAX_TOTAL >> 20} MiB'
            notes.append(f'there are more than {limits}: the rest is left out')
            break

        path = PurePosixPath(member.path)
        data = b''
        fault = _member_fault(member, path, files)
        if not fault:
            try:
                data = member.read(MAX_FILE + 1)
            except Exception as error:  # noqa: BLE001 (a damaged file can raise any)
                fault = f'cannot be read: {_reason_of(error)}'
        if len(data) > MAX_FILE:
            fault = f'is larger than {MAX_FILE >> 20} MiB'
        if fault:
            notes.append(f'{_shown(path)} {fault}')
        else:
            files[member.path] = data
    return files, notes


def _is_left_out(member: Member) -> bool:
    """Return whether a file is no code of the submission."""
    return _is_evidence(member) or any(map(_is_of_tools, PurePosixPath(member.path).parts))


def _is_evidence(member: Member) -> bool:
    return f'/{member.path}'.lower().endswith(_EVIDENCE)


def _member_fault(member: Member, path: PurePosixPath, files: dict[str, bytes]) -> str:
    """Return why a file cannot be taken, as the rest of a sentence; empty if it can."""
    if _leads_out(path):
        return 'leads out of the archive'
    if '\0' in member.path or not 0 < len(os.fsencode(path)) <= _MAX_PATH:
        return f'has a name that no file can have: at most {_MAX_PATH} bytes'
    if any(str(each) in files for each in (path, *path.parents)):
        return 'is there twice: the first one is used'
    return member.fault


def _leads_out(path: PurePosixPath) -> bool:
    return path.is_absolute() or '..' in path.parts


def _is_of_tools(name: str) -> bool:
    """Return whether a tool, not the student, makes files or folders of this name."""
    return name != '..' and name.startswith(('.', '__pycache__', '__MACOSX'))


def _mode_fault(mode: int) -> str:
    """Return why a file of this mode is not read, as the rest of a sentence; empty if it is."""
    if stat.S_ISLNK(mode):
        return 'is a link, which is not followed'
    return '' if stat.S_ISREG(mode) else 'is not a regular file'


def _reason_of(error: Exception) -> str:
    """Return why a file cannot be read."""
    return escaped(getattr(error, 'strerror', None) or str(error) or type(error).__name__)


def _shown(path: PurePosixPath) -> str:
    return one_line(str(path), _SHOWN)
