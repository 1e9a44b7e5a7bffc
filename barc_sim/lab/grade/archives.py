"""Lists the files of an archive without unpacking it; its sizes are bounded."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import stat
import tarfile
import zipfile
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

MAX_ARCHIVE = 256 << 20  # bytes
_MAX_UNPACKED = 256 << 20  # bytes of a .tar
_MAX_MEMBERS = 10_000
_TARS: dict[str, Callable[[Path], Any]] = {
    '.tar': partial(open, mode='rb'),
    '.tar.gz': gzip.open,
    '.tgz': gzip.open,
    '.tar.bz2': bz2.open,
    '.tar.xz': lzma.open,
}
_UNKNOWN = ('.rar', '.7z', '.gz', '.xz', '.bz2', '.zst', '.tar.zst')


class Unreadable(Exception):  # noqa: N818
    """A submission that cannot be opened; the text gives the reason, and what to hand in."""


class Member(NamedTuple):
    """A file of a submission."""

    path: str  #: in its folder or archive, with slashes
    read: Callable[[int], bytes]  #: returns so many bytes at most
    link: bool = False


def is_archive(path: Path) -> bool:
    """Return whether the name of `path` is one of an archive that can be opened.

    Examples
    --------
    >>> is_archive(Path('ada.zip')), is_archive(Path('ada.pdf'))
    (True, False)
    """
    return path.name.lower().endswith(('.zip', *_TARS))


def advice(path: Path) -> str:
    """Return why `path`, which is neither folder nor archive, is not graded."""
    if path.name.lower().endswith(_UNKNOWN):
        return f'a {path.suffix} archive cannot be opened: hand in a .zip or a folder'
    return 'it is a single file: hand in a .zip, or a folder'


def members(path: Path) -> Iterator[Member]:
    """Yield the files of the archive at `path`.

    A damaged archive can raise any exception, here and where a file is read.
    """
    if path.stat().st_size > MAX_ARCHIVE:
        raise Unreadable(f'it has more than {MAX_ARCHIVE >> 20} MiB')
    return _zipped(path) if path.name.lower().endswith('.zip') else _tarred(path)


def _zipped(path: Path) -> Iterator[Member]:
    archive = zipfile.ZipFile(path)
    infos = [info for info in archive.infolist() if not info.is_dir()]
    _check_count(len(infos))
    for info in infos:
        # Some of Windows write backslashes.
        name = info.filename.replace('\\', '/')
        link = stat.S_ISLNK(info.external_attr >> 16)
        yield Member(name, lambda size, info=info: _unzipped(archive, info, size), link)  # type: ignore[misc]


def _unzipped(archive: zipfile.ZipFile, info: zipfile.ZipInfo, size: int) -> bytes:
    with archive.open(info) as file:
        return file.read(size)


def _tarred(path: Path) -> Iterator[Member]:
    """Yield the files of a .tar, which is unpacked in memory: its headers are its own words."""
    ending = max((name for name in _TARS if path.name.lower().endswith(name)), key=len)
    with _TARS[ending](path) as packed:
        data = packed.read(_MAX_UNPACKED + 1)
    if len(data) > _MAX_UNPACKED:
        raise Unreadable(f'it unpacks to more than {_MAX_UNPACKED >> 20} MiB')
    archive = tarfile.open(fileobj=io.BytesIO(data), mode='r:')  # noqa: SIM115
    infos = archive.getmembers()
    _check_count(len(infos))
    for info in infos:
        name = info.name.removeprefix('./')
        if info.isfile():
            yield Member(name, lambda size, info=info: _untarred(archive, info, size))  # type: ignore[misc]
        elif not info.isdir():
            yield Member(name, lambda _: b'', link=True)


def _untarred(archive: tarfile.TarFile, info: tarfile.TarInfo, size: int) -> bytes:
    file = archive.extractfile(info)
    return file.read(size) if file else b''


def _check_count(count: int) -> None:
    if count > _MAX_MEMBERS:
        raise Unreadable(f'it holds {count} files: at most {_MAX_MEMBERS}')
