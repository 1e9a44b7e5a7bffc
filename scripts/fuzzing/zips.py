"""Archives of submissions: damaged ones, and ones whose headers are generated field by field.

Each is read as `grade` does, and its files are written to a folder; none may leave it. Some places
of archives are taken by pipes, links, sockets and folders of those.
"""

from __future__ import annotations

import io
import os
import socket
import stat
import struct
import warnings
import zipfile
import zlib
from functools import cache
from typing import TYPE_CHECKING

from _bytes import TEXTS, damage, number

from barc_sim.lab.submission import read_submission

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from random import Random

_FILES = {'lab/controller.py': b'kp = 1\n' * 40, 'lab/bike_model.py': b'ts = 1\n' * 40}
_NAMES = (*TEXTS, 'lab', 'lab/controller.py/x', '/tmp/x', '..\\x', 'con', 'x' * 300, 'lab/\n')  # noqa: S108
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
#: The records of a .zip: by its mark the name, and the codes of the fields, as in `struct`.
_RECORDS = {
    b'PK\3\4': ('a file', 'HHHHHIIIHH'),
    b'PK\1\2': ('an entry', 'HHHHHHIIIHHHHHII'),
    b'PK\5\6': ('the end', 'HHHHIIH'),
}
_NUMBERS = (0, 1, -1, -512, -1536, 511, 512, 1 << 20, 1 << 31, 1 << 33, 1 << 63, 10**19, 10**400)


def original() -> None:
    """Do nothing: the archives are made as they are needed."""


def clock() -> float:
    """Return the processor time [s] of this process and of those that read for it."""
    return sum(os.times()[:4])


def damaged_file(chance: Random) -> tuple[str, str, bytes]:
    """Return the suffix of a file, what is damaged in it, and its content."""
    match chance.randrange(6):
        case 0:
            return (
                '.zip',
                'any bytes of a .zip',
                damage(_usual_zip(chance.choice(_METHODS)), chance),
            )
        case 1:
            return '.zip', 'names and kinds', _zip_of_odd_names(chance)
        case 2 | 3 | 4:
            return '.zip', 'headers of a .zip', _zip(chance)
    name, content = _with_other_fields(chance)
    return '.zip', f'fields of {name}', content


def _with_other_fields(chance: Random) -> tuple[str, bytes]:
    """Return the name of a record, and a .zip with other numbers in that record."""
    content = bytearray(_usual_zip(chance.choice(_METHODS)))
    mark = chance.choice(sorted(_RECORDS))
    name, codes = _RECORDS[mark]
    fields = content.index(mark) + len(mark)
    for _ in range(chance.choice((1, 1, 3))):
        place = chance.randrange(len(codes))
        begin = fields + struct.calcsize('<' + codes[:place])
        end = begin + struct.calcsize(codes[place])
        content[begin:end] = number(codes[place], bytes(content[begin:end]), chance)
    return name, bytes(content)


def _name(chance: Random) -> str:
    parts = [
        chance.choice(('lab', 'controller.py', 'bike_model.py', '..', '.', 'a' * 256, '\u00e9'))
    ]
    if chance.random() < 0.4:  # noqa: PLR2004 (some)
        parts.append(chance.choice(_NAMES)[: chance.choice((20, 300, 5_000))])
    return '/'.join(chance.sample(parts, len(parts)))


def _zip(chance: Random) -> bytes:
    """Return a .zip of generated records, of any method, flag, size, name and extra field."""
    files = b''
    directory = b''
    entries = _entries(chance)
    for name, data in entries:
        file, entry = _file_and_entry(name, data, len(files), chance)
        files += file
        directory += entry

    repetitions = 1
    if len(directory) < 1_000:  # noqa: PLR2004 (else too much)
        repetitions = chance.choice((1, 1, 1, 1, 100, 5_000))
    directory *= repetitions
    return files + directory + _end(len(files), len(directory), len(entries) * repetitions, chance)


def _entries(chance: Random) -> list[tuple[str, bytes]]:
    """Return names and contents of files."""
    entries = [*_FILES.items()] if chance.random() < 0.5 else []  # noqa: PLR2004 (half)
    for _ in range(chance.choice((1, 2, 8, 100))):
        name = _name(chance)
        entries.append((name, chance.choice((b'', b'kp = 1\n', bytes(5_000)))))
    return entries


def _file_and_entry(name: str, data: bytes, offset: int, chance: Random) -> tuple[bytes, bytes]:
    """Return the record of a file at an offset, and that of its entry in the directory."""
    raw_name = name.encode('utf-8', 'surrogatepass')[:0xFFFF]
    method = chance.choice((*_METHODS, 0, 8, 8, 8, 9, 99))
    packed = zlib.compress(data)[2:-4] if method == zipfile.ZIP_DEFLATED else data
    sizes = [zlib.crc32(data), len(packed), len(data)]
    if chance.random() < 0.2:  # noqa: PLR2004 (some)
        sizes[chance.randrange(3)] = chance.choice(_NUMBERS) % (1 << 32)
    flags = chance.choice((0, 0, 0, 0x800, 1, 8, 0xFFFF))
    extra = b''.join(_extra(chance) for _ in range(chance.choice((0, 0, 1, 4))))[:0xFFFF]
    lengths = (len(raw_name), len(extra))
    common = struct.pack('<HHHHH3I2H', 45, flags, method, 0, 0x21, *sizes, *lengths)

    mode = chance.choice((0, stat.S_IFREG, stat.S_IFLNK, stat.S_IFIFO, stat.S_IFCHR))
    if chance.random() >= 0.9:  # noqa: PLR2004 (few)
        offset = chance.choice(_NUMBERS) % (1 << 32)
    tail = struct.pack('<HHHII', 0, 0, 0, (mode | 0o644) << 16, offset)
    version = struct.pack('<H', 0x31E)
    file = b'PK\3\4' + common + raw_name + extra + packed
    entry = b'PK\1\2' + version + common + tail + raw_name + extra
    return file, entry


def _end(files_size: int, directory_size: int, entries: int, chance: Random) -> bytes:
    """Return the end of a .zip, sometimes with a second one for large archives (ZIP64)."""
    counts = [entries % (1 << 16)] * 2
    places = [directory_size, files_size]
    if chance.random() < 0.2:  # noqa: PLR2004 (some)
        places[chance.randrange(2)] = chance.choice(_NUMBERS) % (1 << 32)
    comment = chance.choice((b'', b'x' * 100, b'PK\5\6' * 9))
    end = struct.pack('<HH2H2IH', 0, 0, *counts, *places, len(comment))

    places_64 = [place % (1 << 64) for place in places]
    end_64 = struct.pack('<Q2H2I4Q', 44, 45, 45, 0, 0, *counts, *places_64)
    place_of_end_64 = chance.choice((files_size + directory_size, 0, 1 << 62))
    locator = struct.pack('<IQI', 0, place_of_end_64, 1)
    zip_64 = b''
    if chance.random() < 0.2:  # noqa: PLR2004 (some)
        zip_64 = b'PK\6\6' + end_64 + b'PK\6\7' + locator
    return zip_64 + b'PK\5\6' + end + comment


def _extra(chance: Random) -> bytes:
    """Return an extra field: sizes of ZIP64, a name in Unicode, or any."""
    sizes = [size % (1 << 64) for size in chance.sample(_NUMBERS, 3)]
    data = chance.choice(
        (
            struct.pack('<3Q', *sizes),
            b'\1' + chance.randbytes(4) + chance.choice(_NAMES).encode()[:400],
            chance.randbytes(chance.randrange(40)),
        )
    )
    size = len(data) if chance.random() < 0.8 else chance.randrange(1 << 16)  # noqa: PLR2004
    kind = chance.choice((1, 0x7075, 0x5455, chance.randrange(1 << 16)))
    return struct.pack('<HH', kind, size) + data


@cache
def _usual_zip(method: int) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, 'w', method) as archive:
        for name, data in _FILES.items():
            archive.writestr(name, data)
    return stream.getvalue()


def _zip_of_odd_names(chance: Random) -> bytes:
    """Return a .zip with files of odd names, kinds and sizes beside the usual ones."""
    warnings.simplefilter('ignore')  # of names that are there twice
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, 'w', zipfile.ZIP_DEFLATED) as archive:
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
    submission = read_submission(path)
    assert submission.files or submission.notes or path.is_dir()  # noqa: S101
    submission.write(folder)

    before = {path}
    if path.is_dir() and not path.is_symlink():
        before.update(path.rglob('*'))
    files = [file for file in path.parent.rglob('*') if file.is_file() and file not in before]
    assert len(files) == len(submission.files)  # noqa: S101
    assert all(file.is_relative_to(folder) for file in files)  # noqa: S101


def _place(path: Path, chance: Random) -> None:
    """Put something else than a file at `path`, or in a folder there."""
    place = path
    path.unlink()
    if chance.random() < 0.5:  # noqa: PLR2004 (half)
        path.mkdir()
        place = path / chance.choice(('controller.py', 'bike_model.py', 'x.zip'))

    match chance.randrange(4):
        case 0:
            os.mkfifo(place)
        case 1:
            place.symlink_to(chance.choice(('/dev/zero', '/etc/passwd', '.', '..', place.name)))
        case 2:
            with socket.socket(socket.AF_UNIX) as server:
                server.bind(os.path.relpath(place))
        case _:
            place.mkdir()
            os.mkfifo(place / 'controller.py')


def uses(chance: Random) -> list[Callable[[Path], object]]:
    """Return what to do with a file, one after the other."""

    def use(path: Path) -> None:
        if chance.random() < 0.05:  # noqa: PLR2004 (some)
            _place(path, chance)
        _grade(path)

    return [use]
