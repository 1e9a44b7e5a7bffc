"""Reads the records of a bag's files, up to the last whole one."""

from __future__ import annotations

import logging
import os
import re
from dataclasses import dataclass
from io import BytesIO
from struct import Struct
from typing import TYPE_CHECKING

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Chunk, McapRecord
from mcap.stream_reader import StreamReader

from barc_sim.bags.bounds import MAX_CHUNK, Budget
from barc_sim.bags.chunk import CHUNK_SIZE
from barc_sim.bags.file import MAGIC
from barc_sim.cli.files import open_regular
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from typing import IO

_HEADER = Struct('<BQ')  # of a record: opcode, length
_OPCODES = frozenset(Opcode)
_logger = logging.getLogger(__name__)


@dataclass
class Damage:
    """The damage found in a file."""

    unreadable_chunks: int = 0
    unfinished: bool = False  #: its end is missing
    unread: int = 0  #: [B] after the last whole record
    cut: bool = False  #: these are at most the beginning of a record, as a kill leaves it

    def __bool__(self) -> bool:
        """Return whether anything is missing."""
        return self.unfinished or self.unreadable_chunks > 0


def files(path: Path) -> list[Path]:
    """Return the MCAP files of a bag; `path` is its directory, or one of the files.

    Raises
    ------
    UserError
        There are none.

    Examples
    --------
    >>> from barc_sim.bags.reader import newest
    >>> len(files(newest('bags')))
    1
    """
    if not path.exists():
        raise UserError(f'there is no bag {str(path)!r}: name the directory of a bag')
    if not path.is_dir():
        return [path.resolve()] if path.is_symlink() else [path]
    found = [file for file in path.glob('*.mcap') if not file.name.startswith('.')]
    if not found:
        raise UserError(f'{str(path)!r} has no .mcap file in it: name the directory of a bag')
    return sorted(found, key=_order)


def _order(file: Path) -> tuple[int, str]:
    """Return a key that sorts `run_10.mcap` after `run_9.mcap`."""
    number = re.search(r'_(\d+)\.mcap$', file.name)
    return int(number[1]) if number else -1, file.name


def records(
    file: Path, *, messages: bool = True, damage: Damage | None = None
) -> Iterator[McapRecord]:
    """Yield a file's records up to the last whole one, without the chunks that are damaged.

    Parameters
    ----------
    file
        The file.
    messages
        False to skip the chunks, and with them the messages.
    damage
        Filled with the damage found; without it, damage is a warning in the log.

    Raises
    ------
    UserError
        It cannot be read, is not an MCAP file, or unpacks to too much.
    """
    found = Damage() if damage is None else damage
    try:
        stream = open_regular(file, follow=False)
        size = os.fstat(stream.fileno()).st_size
    except OSError as error:
        raise UserError(
            f'{str(file)!r} cannot be read ({error.strerror}): name another bag'
        ) from error
    with stream:
        if (magic := stream.read(len(MAGIC))) != MAGIC:
            what = 'not an MCAP file' if magic else 'empty'
            raise UserError(f'{str(file)!r} is {what}: name another bag')
        if messages:
            yield from _described(stream)
        stream.seek(0)
        # A length greater than the file's is damage: no memory is allocated for it.
        reader = _Reader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=size)
        budget = Budget(file, size)
        whole = 0
        try:
            for record in reader.records:
                whole = stream.tell()
                if not isinstance(record, Chunk):
                    yield record
                elif messages:
                    yield from _whole(record, found, budget)
        except UserError:
            raise
        except Exception:  # noqa: BLE001 (damage may raise anything)
            found.unfinished = True
            found.unread = size - whole
            stream.seek(whole)
            found.cut = _is_cut(stream.read(_HEADER.size), found.unread)
    if damage is None and messages and found:
        _logger.warning('%s is unfinished or damaged: read up to the last whole record', file)


def _is_cut(header: bytes, size: int) -> bool:
    """Return whether `size` bytes with this header can be the beginning of a record."""
    if len(header) < _HEADER.size:
        return True
    opcode, length = _HEADER.unpack(header)
    # The longest is a chunk whose messages cannot be compressed.
    return opcode in _OPCODES and size - len(header) < length < 2 * CHUNK_SIZE


class _Reader(StreamReader):
    """Parses each record within its own length: the lengths in it can claim more."""

    def _read_record(self, opcode: int, length: int) -> McapRecord | None:
        whole = self._stream
        body = whole.read(length)
        if len(body) < length:
            raise EOFError
        if opcode == Opcode.METADATA and length > MAX_CHUNK:
            return None  # it would take several times its size
        self._stream = ReadDataStream(BytesIO(body))
        try:
            return super()._read_record(opcode, length)
        finally:
            self._stream = whole


def _described(stream: IO[bytes]) -> list[McapRecord]:
    """Return the schemas and channels of the summary, as a damaged chunk may hold the others."""
    try:
        summary = SeekingReader(stream, validate_crcs=True).get_summary()
        return [*summary.schemas.values(), *summary.channels.values()] if summary else []
    except Exception:  # noqa: BLE001 (damage may raise anything)
        return []


def _whole(chunk: Chunk, damage: Damage, budget: Budget) -> list[McapRecord]:
    try:
        return budget.unpack(chunk)
    except UserError:
        raise
    except Exception:  # noqa: BLE001 (damage may raise anything)
        damage.unreadable_chunks += 1
        return []
