"""Damaged archives of submissions: any bytes, the fields of a .zip, and names and kinds of files.

Each is read as `grade` does, and its files are written to a folder; none may leave it.
"""

from __future__ import annotations

import io
import stat
import struct
import tarfile
import warnings
import zipfile
from functools import cache
from typing import TYPE_CHECKING

from _bytes import TEXTS, damage, number

from barc_sim.lab.grade.submissions import read

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from random import Random

_FILES = {'lab/controller.py': b'kp = 1\n' * 40, 'lab/bike_model.py': b'ts = 1\n' * 40}
_NAMES = (*TEXTS, 'lab', 'lab/controller.py/x', '/tmp/x', '..\\x', 'con', 'x' * 300, 'lab/\n')  # noqa: S108
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
#: The records of a .zip: by its mark the name, and the fields, as in `struct`.
_RECORDS = {
    b'PK\3\4': ('a file', 'HHHHHIIIHH'),
    b'PK\1\2': ('an entry', 'HHHHHHIIIHHHHHII'),
    b'PK\5\6': ('the end', 'HHHHIIH'),
}


def original() -> None:
    """Do nothing: the archives are made as they are needed."""


def damaged(chance: Random) -> tuple[str, str, bytes]:
    """Return the suffix of a file, what is damaged in it, and its content."""
    match chance.randrange(5):
        case 0:
            return '.zip', 'any bytes of a .zip', damage(_zipped(chance.choice(_METHODS)), chance)
        case 1:
            suffix = chance.choice(('', '.gz', '.bz2', '.xz'))
            content = damage(_tarred(suffix[1:]), chance)
            return f'.tar{suffix}', 'any bytes of a .tar', content
        case 2:
            return '.zip', 'names and kinds', _misnamed(chance)
    content = bytearray(_zipped(chance.choice(_METHODS)))
    mark = chance.choice(sorted(_RECORDS))
    name, codes = _RECORDS[mark]
    at = content.index(mark) + len(mark)
    for _ in range(chance.choice((1, 1, 3))):
        k = chance.randrange(len(codes))
        begin = at + struct.calcsize('<' + codes[:k])
        raw = bytes(content[begin : begin + struct.calcsize(codes[k])])
        content[begin : begin + len(raw)] = number(codes[k], raw, chance)
    return '.zip', f'fields of {name}', bytes(content)


@cache
def _zipped(method: int) -> bytes:
    with zipfile.ZipFile(stream := io.BytesIO(), 'w', method) as archive:
        for name, data in _FILES.items():
            archive.writestr(name, data)
    return stream.getvalue()


@cache
def _tarred(packing: str) -> bytes:
    with tarfile.open(fileobj=(stream := io.BytesIO()), mode=f'w:{packing}') as archive:
        for name, data in _FILES.items():
            info = tarfile.TarInfo(name)
            info.size = len(data)
            archive.addfile(info, io.BytesIO(data))
    return stream.getvalue()


def _misnamed(chance: Random) -> bytes:
    """Return a .zip with files of odd names, kinds and sizes beside the usual ones."""
    warnings.simplefilter('ignore')  # of names that are there twice
    with zipfile.ZipFile(stream := io.BytesIO(), 'w', zipfile.ZIP_DEFLATED) as archive:
        for name, data in _FILES.items():
            archive.writestr(name, data)
        count, size = chance.choice(((1, 2 << 20), (5, 10), (5, 0), (300, 10)))
        for _ in range(count):
            info = zipfile.ZipInfo(chance.choice(_NAMES)[:60_000])
            mode = chance.choice((stat.S_IFREG, stat.S_IFLNK, stat.S_IFIFO, stat.S_IFDIR))
            info.external_attr = (mode | chance.choice((0, 0o644, 0o7777))) << 16
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, bytes(size))
    return stream.getvalue()


def _grade(path: Path) -> None:
    folder = path.with_suffix('.read')
    folder.mkdir()
    submission = read(path)
    assert submission.files or submission.notes  # noqa: S101
    submission.write(folder)
    written = [file for file in path.parent.rglob('*') if file.is_file() and file != path]
    assert len(written) == len(submission.files)  # noqa: S101
    assert all(file.is_relative_to(folder) for file in written)  # noqa: S101


def uses(_: Random) -> list[Callable[[Path], object]]:
    """Return what to do with a file, one after the other."""
    return [_grade]
