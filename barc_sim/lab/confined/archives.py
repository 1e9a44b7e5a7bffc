"""Reads an archive, in a process of its own: its headers are a stranger's words."""

from __future__ import annotations

import bz2
import gzip
import lzma
import pathlib
import stat
import tarfile
import zipfile
from base64 import b64encode
from functools import partial
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

MAX_ENTRIES = 2_000
_MAX_NAME = 1_200  # characters of a name that are sent; no file can have as many
_TARS: dict[str, Callable[[str], Any]] = {
    '.tar': partial(open, mode='rb'),
    '.tar.gz': gzip.open,
    '.tgz': gzip.open,
    '.tar.bz2': bz2.open,
    '.tar.xz': lzma.open,
}
ENDINGS = ('.zip', *_TARS)


class Archive:
    """The files of an archive; a damaged one can raise any exception."""

    def __init__(self, path: str) -> None:
        """Open the archive at `path`, whose ending is one of `ENDINGS`."""
        self._archive: Any = None
        ending = max((end for end in ENDINGS if path.lower().endswith(end)), key=len)
        self._file = _TARS[ending](path) if ending in _TARS else pathlib.Path(path).open('rb')  # noqa: SIM115
        self._list = self._zipped if ending == '.zip' else self._tarred
        self._infos: list[Any] = []

    def call(self, do: str, *arguments: int) -> list[tuple[str, str]] | str:
        """Answer a request: for the `members`, or to `read` one."""
        return self._read(*arguments) if do == 'read' else self._members()

    def _members(self) -> list[tuple[str, str]]:
        """Return name and kind of all but folders, in their order: empty, `link` or `other`."""
        found: list[tuple[str, str]] = []
        for name, kind, info in self._list():
            if len(found) >= MAX_ENTRIES:
                raise OverflowError(f'it holds more than {MAX_ENTRIES} files')
            found.append((name[:_MAX_NAME], kind))
            self._infos.append(info)
        return found

    def _read(self, number: int, size: int) -> str:
        """Return at most `size` bytes of a file, in base 64."""
        info = self._infos[number]
        tarred = isinstance(info, tarfile.TarInfo)
        with self._archive.extractfile(info) if tarred else self._archive.open(info) as file:
            return b64encode(file.read(size)).decode()

    def _zipped(self) -> Iterator[tuple[str, str, Any]]:
        self._archive = zipfile.ZipFile(self._file)
        for info in self._archive.infolist():
            if not info.is_dir():
                kind = stat.S_IFMT(info.external_attr >> 16)
                word = {0: '', stat.S_IFREG: '', stat.S_IFLNK: 'link'}.get(kind, 'other')
                # Some of Windows write backslashes.
                yield info.filename.replace('\\', '/'), word, info

    def _tarred(self) -> Iterator[tuple[str, str, Any]]:
        self._archive = tarfile.open(fileobj=self._file, mode='r:')  # noqa: SIM115
        for number, info in enumerate(self._archive):
            # A negative size leads back to the headers before it, for ever.
            if info.size < 0 or number > MAX_ENTRIES:
                raise OverflowError(
                    f'it holds more than {MAX_ENTRIES} entries'
                    if number > MAX_ENTRIES
                    else f'an entry has the size {info.size}'
                )
            if not info.isdir():
                link = info.issym() or info.islnk()
                word = 'link' if link else '' if info.isfile() else 'other'
                yield info.name.removeprefix('./'), word, info
