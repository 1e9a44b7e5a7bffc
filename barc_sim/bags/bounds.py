"""Bounds on what is read from a bag, which can come from anyone.

Each is far beyond what a run records. What exceeds one is named in a UserError.
"""

from __future__ import annotations

import json
import zlib
from io import BytesIO
from typing import TYPE_CHECKING, Any

import lz4.frame
import numpy as np
import yaml
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Schema

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path

    from barc_sim.simulation.log import Log

MAX_CHUNK = 64 << 20  #: bytes, unpacked
MAX_SCHEMA = 16 << 10  #: bytes of a definition that is parsed
MAX_SCHEMAS = 32  #: definitions that are parsed
MAX_TERMS = 64  #: of a controller
MAX_TEXT = 10_000  #: characters of an entry of the run's metadata
MAX_LONG_TEXT = 200_000  #: characters of `LONG`
LONG = ('parameters', 'graph')
MAX_NODES = 300  #: and topics, of a graph
MAX_LINKS = 3000
MAX_NAME = 300  #: characters
MAX_GAP = 86_400.0  #: [s] between the stamps of two states
MAX_DURATION = 172_800.0  #: [s]
_MAX_DEPTH = 20  # of nested YAML
_MAX_DIGITS = 20


class Budget:
    """How much a file may unpack to.

    A message needs 16 bytes in a file's index, and a few even without; a chunk of equal messages
    shrinks to a thousandth at most.
    """

    def __init__(self, file: Path, size: int) -> None:
        self._file = file
        self._bytes = MAX_CHUNK + 1000 * size
        self._records = 10_000 + size // 4

    def unpack(self, chunk: Chunk) -> list[McapRecord]:
        """Return a chunk's schemas, channels and messages.

        Raises
        ------
        UserError
            The file unpacks to too much.
        Exception
            The chunk is damaged, or too large.
        """
        data = _unpacked(chunk)
        if chunk.uncompressed_crc not in {0, zlib.crc32(data)}:
            raise ValueError('checksum')
        self._bytes -= len(data)
        stream = ReadDataStream(BytesIO(data))
        records: list[McapRecord] = []
        while stream.count < len(data):
            self._records -= 1
            if min(self._bytes, self._records) < 0:
                raise UserError(
                    f'{str(self._file)!r} unpacks to more than a recording of its size can hold: '
                    'name another bag'
                )
            opcode, length = stream.read1(), stream.read8()
            if opcode == Opcode.MESSAGE:
                records.append(Message.read(stream, length))
            elif opcode == Opcode.CHANNEL:
                records.append(Channel.read(stream))
            elif opcode == Opcode.SCHEMA:
                records.append(Schema.read(stream))
            else:
                stream.read(length)
        return records


def _unpacked(chunk: Chunk) -> bytes:
    if chunk.compression == 'zstd':
        # The size in the frame's own header decides how much is allocated.
        if zstandard.frame_content_size(chunk.data) > MAX_CHUNK:
            raise ValueError('size')
        return zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=MAX_CHUNK)
    if chunk.compression == 'lz4':
        data: bytes = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, MAX_CHUNK + 1)
        if len(data) > MAX_CHUNK:
            raise ValueError('size')
        return data
    if chunk.compression:
        raise ValueError(f'unknown compression {chunk.compression!r}')
    return chunk.data


def from_json(text: str) -> Any:  # noqa: ANN401 (any JSON)
    """Return the value of a bag's JSON.

    Raises
    ------
    ValueError
        It is no JSON, too long or too deep.

    Examples
    --------
    >>> from_json('{"kp": 30.0}')
    {'kp': 30.0}
    """
    _check_length(text)
    try:
        return json.loads(text, parse_int=_whole)
    except RecursionError:
        raise ValueError('too many brackets within brackets') from None


def _whole(digits: str) -> int:
    if len(digits) > _MAX_DIGITS:
        raise ValueError(f'a number of {len(digits)} digits')
    return int(digits)


class _Loader(yaml.SafeLoader):
    """Loads YAML as rosbag2 writes it: without aliases, and nested a little."""

    depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError('an alias')
        self.depth += 1
        if self.depth > _MAX_DEPTH:
            raise yaml.YAMLError('too many values within values')
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


def from_yaml(text: str) -> Any:  # noqa: ANN401 (any YAML)
    """Return the value of a bag's YAML, which has no aliases.

    Raises
    ------
    ValueError
        It is no YAML, too long or too deep, or has an alias.
    """
    _check_length(text)
    try:
        return yaml.load(text, Loader=_Loader)  # noqa: S506 (a SafeLoader)
    except (yaml.YAMLError, RecursionError, AttributeError, TypeError, KeyError) as error:
        raise ValueError(f'no YAML of a bag: {error}') from None


def _check_length(text: str) -> None:
    if len(text) > MAX_LONG_TEXT:
        raise ValueError(f'{len(text)} characters')


def check_entries(path: Path, entries: dict[str, str]) -> dict[str, str]:
    """Return the metadata of a run.

    Raises
    ------
    UserError
        An entry is too long, or there are too many.
    """
    for name, text in entries.items():
        most = MAX_LONG_TEXT if name in LONG else MAX_TEXT
        if len(text) > most or len(name) > MAX_TEXT:
            raise UserError(
                f'{str(path)!r} has {len(text)} characters of metadata {name[:40]!r}, where a run '
                f'has at most {most}: name the bag of a run'
            )
    if len(entries) > MAX_TEXT:
        raise UserError(f'{str(path)!r} has {len(entries)} entries of metadata: name another bag')
    return entries


def check_log(path: Path, log: Log) -> Log:
    """Return the log of a run.

    Raises
    ------
    UserError
        Its stamps or grades are none of a run.
    """
    gaps = np.diff(log.t, prepend=0.0)
    k = int(np.argmax(gaps))
    if gaps[k] > MAX_GAP or log.t[-1] > MAX_DURATION:
        raise UserError(
            f'{str(path)!r} has states of {log.t[-1]:.6g} s, with {gaps[k]:.6g} s between two of '
            f'them, where a run has at most {MAX_DURATION:g} s and {MAX_GAP:g} s: '
            'name the bag of a run'
        )
    steep = np.abs(log.theta_deg) >= 90.0  # noqa: PLR2004 (upright)
    if steep.any():
        theta = log.theta_deg[steep][0]
        raise UserError(
            f'{str(path)!r} has a grade of {theta:.6g} degrees, where a road has less than 90: '
            'name the bag of a run'
        )
    return log
