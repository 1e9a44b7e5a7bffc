"""Archives that take too much time, memory or room to open."""

from __future__ import annotations

import io
import struct
import zipfile
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


def entries(count: int) -> bytes:
    """Return a .zip with a directory of so many entries."""
    entry = struct.pack('<4s6H3I5H2I', b'PK\1\2', *[0] * 9, 1, *[0] * 6) + b'x'
    end = struct.pack(
        '<4sQ2H2I4Q', b'PK\6\6', 44, 45, 45, 0, 0, *[count] * 2, len(entry) * count, 0
    )
    where = struct.pack('<4sIQI', b'PK\6\7', 0, len(entry) * count, 1)
    last = struct.pack('<4s4H2IH', b'PK\5\6', 0, 0, 0xFFFF, 0xFFFF, *[0xFFFFFFFF] * 2, 0)
    return entry * count + end + where + last


def zeros(method: int) -> bytes:
    """Return a .zip of a model that is 8 MiB of zeros, packed by a method."""
    with zipfile.ZipFile(stream := io.BytesIO(), 'w', method) as archive:
        archive.writestr('bike_model.py', bytes(8 << 20))
    return stream.getvalue()


#: What makes the .zip, and the sentence.
BOMBS: dict[str, tuple[Callable[[], bytes], str]] = {
    'many entries': (lambda: entries(100_000), 'it contains too many files'),
    'a million entries': (lambda: entries(1_000_000), 'it contains too many files'),
    'zeros': (lambda: zeros(zipfile.ZIP_DEFLATED), 'bike_model.py is larger than 1 MiB'),
    'zeros by LZMA': (
        lambda: zeros(zipfile.ZIP_LZMA),
        'bike_model.py is compressed in an uncommon way',
    ),
}
