"""An MCAP file as a list of records with fields, to damage them one by one."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import lz4.frame
import zstandard
from mcap.opcode import Opcode

if TYPE_CHECKING:
    from collections.abc import Iterator

MAGIC = b'\x89MCAP0\r\n'
#: The fields of each kind of record: numbers as in `struct`, and by the size of their length
#: `s` a string, `m` a map and `a` an array (4 bytes), `d` data (4), `D` data (8), `r` the rest.
_FIELDS = {
    Opcode.HEADER: 'profile s, library s',
    Opcode.FOOTER: 'summary start Q, summary offset start Q, summary crc I',
    Opcode.SCHEMA: 'id H, name s, encoding s, definition d',
    Opcode.CHANNEL: 'id H, schema H, topic s, encoding s, metadata m',
    Opcode.MESSAGE: 'channel H, sequence I, log time Q, time Q, data r',
    Opcode.CHUNK: 'start Q, end Q, size Q, crc I, compression s, records D',
    Opcode.MESSAGE_INDEX: 'channel H, entries a',
    Opcode.CHUNK_INDEX: (
        'start Q, end Q, offset Q, length Q, indexes a, index length Q, compression s, '
        'packed size Q, size Q'
    ),
    Opcode.ATTACHMENT: 'log time Q, time Q, name s, media type s, data D, crc I',
    Opcode.ATTACHMENT_INDEX: 'offset Q, length Q, log time Q, time Q, size Q, name s, media type s',
    Opcode.STATISTICS: (
        'messages Q, schemas H, channels I, attachments I, metadata I, chunks I, start Q, '
        'end Q, by channel a'
    ),
    Opcode.METADATA: 'name s, entries m',
    Opcode.METADATA_INDEX: 'offset Q, length Q, name s',
    Opcode.SUMMARY_OFFSET: 'kind B, start Q, length Q',
    Opcode.DATA_END: 'crc I',
}
FIELDS: dict[int, dict[str, str]] = {
    kind: {name: code for name, _, code in (each.rpartition(' ') for each in text.split(', '))}
    for kind, text in _FIELDS.items()
}
_LENGTHS = {'s': 'I', 'm': 'I', 'a': 'I', 'd': 'I', 'D': 'Q'}


@dataclass
class Record:
    """A record; those of a chunk, unpacked, are its `inner` ones."""

    kind: int
    body: bytes
    inner: list[Record] = field(default_factory=list)
    length: int | None = None  #: what its header claims in place of the truth

    @property
    def name(self) -> str:
        """The name of its kind."""
        return Opcode(self.kind).name.lower().replace('_', ' ')

    def fields(self) -> dict[str, bytes]:
        """Return its fields by name, each with the length that stands before it.

        Of a record that is damaged already, none.
        """
        try:
            return self._fields()
        except struct.error:
            return {}

    def _fields(self) -> dict[str, bytes]:
        found = {}
        at = 0
        for name, code in FIELDS[self.kind].items():
            if code == 'r':
                size = len(self.body) - at
            elif code in _LENGTHS:
                prefix = '<' + _LENGTHS[code]
                size = struct.calcsize(prefix) + struct.unpack_from(prefix, self.body, at)[0]
            else:
                size = struct.calcsize(code)
            found[name] = self.body[at : at + size]
            at += size
        return found

    def packed(self) -> bytes:
        """Return it as it stands in a file."""
        length = len(self.body) if self.length is None else self.length
        return struct.pack('<BQ', self.kind, length) + self.body


def with_length(code: str, data: bytes) -> bytes:
    """Return the field of `data`, whose length stands before it."""
    return struct.pack('<' + _LENGTHS[code], len(data)) + data


def without_length(code: str, raw: bytes) -> bytes:
    """Return the data of a field."""
    return raw[struct.calcsize('<' + _LENGTHS[code]) :]


def records(content: bytes) -> Iterator[Record]:
    """Yield the whole records of a file, or of an unpacked chunk."""
    at = len(MAGIC) if content.startswith(MAGIC) else 0
    while at + 9 <= len(content) and content[at] in FIELDS:
        kind, length = struct.unpack_from('<BQ', content, at)
        record = Record(kind, content[at + 9 : at + 9 + length])
        if kind == Opcode.CHUNK:
            packed = without_length('D', record.fields()['records'])
            record.inner = list(records(zstandard.ZstdDecompressor().decompress(packed)))
        yield record
        at += 9 + length


_COMPRESSORS = {
    b'zstd': lambda data: zstandard.ZstdCompressor().compress(data),
    b'lz4': lz4.frame.compress,
    b'': bytes,
}


def pack_chunk(chunk: Record, compression: bytes, *, checked: bool) -> None:
    """Compress a chunk's records, after they were damaged, with the right checksum or none."""
    data = b''.join(record.packed() for record in chunk.inner)
    fields = chunk.fields()
    if not fields:
        return
    fields |= {
        'size': struct.pack('<Q', len(data)),
        'crc': struct.pack('<I', zlib.crc32(data) if checked else 0),
        'compression': with_length('s', compression),
        'records': with_length('D', _COMPRESSORS[compression](data)),
    }
    chunk.body = b''.join(fields.values())


def assemble(found: list[Record], *, finished: bool) -> bytes:
    """Return the file; a `finished` one gets a footer that leads to its summary."""
    content = bytearray(MAGIC)
    start = 0
    for record in found:
        if (
            finished
            and record.kind == Opcode.FOOTER
            and len(record.body) == struct.calcsize('<QQI')
        ):
            record.body = struct.pack('<QQI', start, 0, 0)
        content += record.packed()
        if record.kind == Opcode.DATA_END:
            start = len(content)
    return bytes(content + MAGIC) if finished else bytes(content)
