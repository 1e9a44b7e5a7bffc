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
    from collections.abc import Iterable, Iterator

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


def _fields(text: str) -> dict[str, str]:
    """Return the code of each field, by its name."""
    codes = {}
    for declaration in text.split(', '):
        name, _, code = declaration.rpartition(' ')
        codes[name] = code
    return codes


#: By kind of record, the code of each field.
FIELDS: dict[int, dict[str, str]] = {kind: _fields(text) for kind, text in _FIELDS.items()}
#: By the code of a field, the number that stands before it: the size of its data.
_LENGTHS = {'s': 'I', 'm': 'I', 'a': 'I', 'd': 'I', 'D': 'Q'}
_FOOTER = struct.Struct('<QQI')


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
        fields = {}
        at = 0
        for name, code in FIELDS[self.kind].items():
            if code == 'r':
                size = len(self.body) - at
            elif code in _LENGTHS:
                prefix = '<' + _LENGTHS[code]
                (length,) = struct.unpack_from(prefix, self.body, at)
                size = struct.calcsize(prefix) + length
            else:
                size = struct.calcsize(code)

            fields[name] = self.body[at : at + size]
            at += size
        return fields

    def pack(self) -> bytes:
        """Return it as it stands in a file."""
        length = len(self.body) if self.length is None else self.length
        return struct.pack('<BQ', self.kind, length) + self.body


def with_inner(file_records: Iterable[Record]) -> Iterator[Record]:
    """Yield each record, and after it those that are in it."""
    for record in file_records:
        yield record
        yield from record.inner


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
        end = at + 9 + length
        record = Record(kind, content[at + 9 : end])
        if kind == Opcode.CHUNK:
            packed = without_length('D', record.fields()['records'])
            record.inner = list(records(zstandard.ZstdDecompressor().decompress(packed)))
        yield record
        at = end


_COMPRESSORS = {
    b'zstd': lambda data: zstandard.ZstdCompressor().compress(data),
    b'lz4': lz4.frame.compress,
    b'': bytes,
}


def pack_chunk(chunk: Record, compression: bytes, *, checked: bool) -> None:
    """Compress a chunk's records, after they were damaged, with the right checksum or none."""
    fields = chunk.fields()
    if not fields:
        return

    data = b''.join(record.pack() for record in chunk.inner)
    fields |= {
        'size': struct.pack('<Q', len(data)),
        'crc': struct.pack('<I', zlib.crc32(data) if checked else 0),
        'compression': with_length('s', compression),
        'records': with_length('D', _COMPRESSORS[compression](data)),
    }
    chunk.body = b''.join(fields.values())


def assemble(file_records: list[Record], *, finished: bool) -> bytes:
    """Return the file; a `finished` one gets a footer that leads to its summary."""
    content = bytearray(MAGIC)
    summary_start = 0
    for record in file_records:
        is_footer = record.kind == Opcode.FOOTER and len(record.body) == _FOOTER.size
        if finished and is_footer:
            record.body = _FOOTER.pack(summary_start, 0, 0)

        content += record.pack()
        if record.kind == Opcode.DATA_END:
            summary_start = len(content)

    if finished:
        content += MAGIC
    return bytes(content)
