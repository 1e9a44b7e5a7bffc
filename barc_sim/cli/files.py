"""Opens and writes files safely in folders that somebody else may have made.

A bag, a submission or a folder of results can come from anyone: it can hold a named pipe that never
ends, or a link to another file of the user. Only regular files are opened. Output goes to a new
file, which takes its name when it is whole: a link of that name is replaced, never followed.
"""

from __future__ import annotations

import os
import stat
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from contextlib import ExitStack, contextmanager, suppress
from errno import ENOTDIR
from pathlib import Path, PurePath
from secrets import token_hex
from typing import TYPE_CHECKING, BinaryIO

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from typing_extensions import Self

FIGURES = ('png', 'pdf', 'svg')  #: suffixes of a figure's file
_KINDS = {
    stat.S_IFIFO: 'a named pipe',
    stat.S_IFSOCK: 'a socket',
    stat.S_IFCHR: 'a device',
    stat.S_IFBLK: 'a device',
    stat.S_IFDIR: 'a folder',
    stat.S_IFLNK: 'a link',
}


def _flags(*names: str) -> int:
    """Return these flags of `os.open` together; Windows and macOS lack some."""
    flags = 0
    for name in ('O_CLOEXEC', 'O_BINARY', *names):
        flags |= getattr(os, name, 0)
    return flags


_OPEN_REGULAR = os.O_RDONLY | _flags('O_NONBLOCK', 'O_NOCTTY')


def _check_regular(path: Path, status: os.stat_result) -> None:
    if not stat.S_ISREG(status.st_mode):
        kind = _KINDS.get(stat.S_IFMT(status.st_mode), 'something else')
        raise UserError(f'{str(path)!r} is {kind}, where a regular file is expected: name another')


def open_regular(path: Path, *, follow: bool = True) -> BinaryIO:
    """Open a regular file for reading; this never waits, unlike the opening of a named pipe.

    Parameters
    ----------
    path
        The file.
    follow
        Whether it may be a link: only where the user names the file, not in a folder that somebody
        else has made.

    Raises
    ------
    UserError
        It is no regular file.
    OSError
        It cannot be read.
    """
    # Checked before the opening, which can act on a device, and after it, for a change meanwhile.
    _check_regular(path, path.stat(follow_symlinks=follow))
    flags = _OPEN_REGULAR
    if not follow:
        flags |= _flags('O_NOFOLLOW')

    descriptor = os.open(path, flags)
    return _regular_file(path, descriptor)


def _regular_file(path: Path, descriptor: int) -> BinaryIO:
    """Return the file of a descriptor; UserError: it is no regular file."""
    try:
        _check_regular(path, os.fstat(descriptor))
    except UserError:
        os.close(descriptor)
        raise
    return os.fdopen(descriptor, 'rb')


#: Where a folder is: its descriptor, or its path on a system without such descriptors.
_Place = int | Path
_HAS_DESCRIPTORS = {os.open, os.stat} <= os.supports_dir_fd and os.scandir in os.supports_fd
_TOP = PurePath()


class HeldFolder:
    """A folder that is held open, so that all that is read is really in it.

    Somebody else can exchange a folder for a link while it is read. So each file is opened from the
    descriptor of the folder that it is in, down from this one, and no link is followed. Windows has
    no such descriptors: there each folder is checked just before it is used.
    """

    def __init__(self, path: Path) -> None:
        """Open the folder at `path`; OSError: it is none, or a link."""
        self.path = path
        self._place = _open_folder(path)

    def __enter__(self) -> Self:
        """Return it."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        _close_folder(self._place)

    def entries(self, folder: PurePath = _TOP) -> dict[str, os.stat_result]:
        """Return what is in a folder below it, by name; OSError: it is unreadable, or a link."""
        statuses = {}
        with self._at(folder) as place, os.scandir(place) as entries:
            for entry in entries:
                with suppress(FileNotFoundError):  # it has just been removed
                    statuses[entry.name] = entry.stat(follow_symlinks=False)
        return statuses

    def open(self, file: PurePath) -> BinaryIO:
        """Open a regular file below it, as `open_regular` does."""
        with self._at(file.parent) as place:
            if isinstance(place, Path):
                return open_regular(place / file.name, follow=False)

            path = self.path / file
            _check_regular(path, os.stat(file.name, dir_fd=place, follow_symlinks=False))
            descriptor = os.open(file.name, _OPEN_REGULAR | _flags('O_NOFOLLOW'), dir_fd=place)
            return _regular_file(path, descriptor)

    @contextmanager
    def _at(self, folder: PurePath) -> Iterator[_Place]:
        """Give the place of a folder below it."""
        with ExitStack() as places:
            place = self._place
            for name in folder.parts:
                place = _open_folder(name, place)
                places.callback(_close_folder, place)
            yield place


def _open_folder(name: str | Path, place: _Place | None = None) -> _Place:
    """Open a folder at a place; OSError: it is none, or a link."""
    if isinstance(place, int) or (place is None and _HAS_DESCRIPTORS):
        return os.open(name, os.O_RDONLY | _flags('O_DIRECTORY', 'O_NOFOLLOW'), dir_fd=place)

    path = Path(name) if place is None else place / name
    if not stat.S_ISDIR(path.lstat().st_mode):
        raise NotADirectoryError(ENOTDIR, os.strerror(ENOTDIR), str(path))
    return path


def _close_folder(place: _Place) -> None:
    if isinstance(place, int):
        os.close(place)


def read_regular(path: Path, limit: int, *, follow: bool = True) -> bytes:
    """Return the bytes of a regular file, opened as by `open_regular`.

    Raises
    ------
    UserError
        It is not a regular file, or has more than `limit` bytes.
    OSError
        It cannot be read.
    """
    with open_regular(path, follow=follow) as file:
        data = file.read(limit + 1)
    if len(data) > limit:
        raise UserError(f'{str(path)!r} has more than {limit} bytes: name a smaller file')
    return data


def decoded(data: bytes) -> str:
    r"""Return the text of a file in UTF-8, in UTF-16 with a byte order mark, or in Windows-1252.

    Raises
    ------
    ValueError
        It is no text.

    Examples
    --------
    >>> decoded('Zoë'.encode('cp1252')), decoded('Zoë'.encode('utf-16'))
    ('Zoë', 'Zoë')
    """
    encodings = ['utf-8-sig', 'cp1252', 'latin-1']
    if data.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        encodings = ['utf-16']

    for encoding in encodings:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if '\0' not in text:
            return text
    raise ValueError('it is no text in UTF-8, UTF-16 or Windows-1252')


@contextmanager
def replacing(path: Path, *, sync: bool = False) -> Iterator[Path]:
    """Give a new, empty file beside `path`, which replaces it when the block succeeds.

    If the block fails, `path` is unchanged, and the new file is removed.

    Parameters
    ----------
    path
        The file to write.
    sync
        Whether the data is on the disk before the replacement.

    Raises
    ------
    OSError
        The new file cannot be made, or writing fails.
    """
    part = path.with_name(f'.{token_hex(8)}{path.suffix}')
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | _flags('O_NOFOLLOW')
    descriptor = os.open(part, flags, 0o666)
    os.close(descriptor)

    try:
        yield part

        if sync:
            with part.open('rb+') as file:
                os.fsync(file.fileno())
        part.replace(path)
    finally:
        with suppress(OSError):
            part.unlink()


@contextmanager
def saving(path: Path, option: str = '--save') -> Iterator[Path]:
    """Do as `replacing` does for a file that the user named with `option`, but raise UserErrors."""
    try:
        with replacing(path) as part:
            yield part
    except OSError as error:
        reason = error.strerror or str(error).partition('\n')[0]
        raise UserError(
            f'cannot save {str(path)!r}: {reason}; choose another place with {option}'
        ) from None


def target(name: str, formats: Sequence[str]) -> Path:
    """Return the path `name` to save to; UserError unless it ends in one of `formats` (`png`)."""
    path = Path(name)
    if path.suffix.lower().lstrip('.') not in formats:
        endings = [f'.{suffix}' for suffix in formats]
        expected = endings[-1]
        if len(endings) > 1:
            expected = f'{", ".join(endings[:-1])} or {expected}'
        raise UserError(f'cannot save {name!r}: the name must end in {expected}')

    if path.is_dir():
        raise UserError(f'cannot save {name!r}: there is a folder of that name')
    return path


def figure_path(name: str | None) -> Path | None:
    """Return the path `name` to save a figure to, if there is one."""
    return None if name is None else target(name, FIGURES)


def make_folder(path: Path, within: Path) -> Path:
    """Make and return the folder `path` in the folder `within`, in which no link is followed."""
    within.mkdir(parents=True, exist_ok=True)

    folder = within
    for name in path.relative_to(within).parts:
        folder /= name
        with suppress(FileExistsError):
            folder.mkdir()
        if not stat.S_ISDIR(folder.lstat().st_mode):
            raise NotADirectoryError(ENOTDIR, f'{str(folder)!r} is not a plain folder')
    return path


def check_plain(folder: Path) -> None:
    """Raise UserError if `folder` has anything but plain files; call it before writing there.

    Then a write cannot reach a file elsewhere.
    """
    with os.scandir(folder) as entries:
        for entry in entries:
            if not entry.is_file(follow_symlinks=False):
                status = entry.stat(follow_symlinks=False)
                kind = _KINDS.get(stat.S_IFMT(status.st_mode), 'special')
                raise UserError(
                    f'{entry.path!r} is {kind}, where a bag has plain files only: copy its .mcap '
                    'files to a new folder, and name that'
                )
