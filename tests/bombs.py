"""Archives that take too much time, memory or room to open."""

from __future__ import annotations

import gzip
import lzma
import struct
import tarfile
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


def pax(field: str, value: bytes, *, size: int | None = None) -> bytes:
    """Return a .tar whose one file has a field of an extended header."""
    record = f' {field}='.encode() + value + b'\n'
    length = len(record)
    while length != len(str(length)) + len(record):
        length = len(str(length)) + len(record)
    record = str(length).encode() + record
    header = tarfile.TarInfo('header')
    header.type, header.size = tarfile.XHDTYPE, len(record)
    file = tarfile.TarInfo('controller.py')
    file.size = size or 0
    padding = bytes(-len(record) % 512)
    return b''.join((header.tobuf(), record, padding, file.tobuf(), bytes(1024)))


def members(count: int) -> bytes:
    """Return a .tar of so many empty files."""
    return tarfile.TarInfo('x').tobuf() * count + bytes(1024)


def entries(count: int) -> bytes:
    """Return a .zip with a directory of so many entries."""
    entry = struct.pack('<4s6H3I5H2I', b'PK\1\2', *[0] * 9, 1, *[0] * 6) + b'x'
    end = struct.pack(
        '<4sQ2H2I4Q', b'PK\6\6', 44, 45, 45, 0, 0, *[count] * 2, len(entry) * count, 0
    )
    where = struct.pack('<4sIQI', b'PK\6\7', 0, len(entry) * count, 1)
    last = struct.pack('<4s4H2IH', b'PK\5\6', 0, 0, 0xFFFF, 0xFFFF, *[0xFFFFFFFF] * 2, 0)
    return entry * count + end + where + last


TOO_MUCH = 'it takes more than 8 s or 300 MB to unpack: hand in a smaller one'
BOMBS: dict[str, tuple[str, Callable[[], bytes], str]] = {
    'a size below 0': ('.tar.gz', lambda: pax('size', b'-1536'), 'the size -1536'),
    'a size of many digits': ('.tar.gz', lambda: pax('size', b'9' * 200_000), TOO_MUCH),
    'a name of 200 MB': ('.tar.gz', lambda: pax('path', b'x' * (200 << 20)), TOO_MUCH),
    'many members': ('.tar.gz', lambda: members(520_000), 'it holds more than 2000'),
    'zeros': ('.tar.xz', lambda: bytes(20 << 20), 'it is empty'),
    'many entries': ('.zip', lambda: entries(3_000), 'it holds more than 2000'),
    'a million entries': ('.zip', lambda: entries(1_000_000), TOO_MUCH),
    'five million': ('.zip', lambda: entries(5_000_000), TOO_MUCH),
}
PACKED = {'.tar.gz': gzip.compress, '.tar.xz': lzma.compress, '.zip': bytes}
