"""Bounds on the size of a bag's contents, because a bag can come from anyone.

Each bound is far beyond what a run records. A UserError names what exceeds it.
"""

from __future__ import annotations

import json
from math import inf
from time import thread_time
from typing import TYPE_CHECKING, Any, NoReturn

from barc_sim.bags.bag_files import is_compressed, side_files
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

MAX_RECORD = 32 << 20  #: bytes of a record
MAX_CHUNK = 256 << 20  #: bytes of an unpacked chunk, where the bag is as large
MAX_PACKING = 16  #: by which the compression of a whole file makes it smaller
MAX_METADATA = 2 << 20  #: bytes of a record of metadata
MAX_TRACK = 1 << 20  #: bytes of the file with a track
MAX_KEPT = 16 << 20  #: bytes of a bag's topics, metadata and attached files
MAX_SCHEMA = 16 << 10  #: bytes of a definition that is parsed
MAX_SCHEMAS = 32  #: definitions that are parsed
MAX_ARRAY = 1000  #: numbers in an array of fixed length
MAX_MESSAGE = 64 << 10  #: bytes of a message that is decoded
MAX_TERMS = 64  #: of a controller
MAX_PARAMETERS = 20_000  #: of all nodes
MAX_QOS = 50_000  #: characters of the QoS that a topic's publishers offer
MAX_TEXT = 200_000  #: characters of an entry of the run's metadata
MAX_NODES = 300  #: nodes and topics of a graph
MAX_LINKS = 3000  #: of a graph
MAX_NAME = 300  #: characters
MAX_GAP = 86_400.0  #: [s] between the stamps of two states
MAX_DURATION = 172_800.0  #: [s]
MAX_DISTANCE = 1e9  #: [m] from the start, either way


class Budget:
    """Limits one reading of a bag: unpacked bytes, records, and the thread's processor time.

    A recording has 16 bytes of index for each message, and compression makes a chunk of equal
    messages at most a thousand times smaller.

    Parameters
    ----------
    files
        The bag's files.
    timed
        Whether the time is limited, from now on.
    """

    def __init__(self, files: Sequence[Path], *, timed: bool = True) -> None:
        self.file = files[0]
        self._size = 0  # [B] on the disk
        self._unpacked_size = 0  # [B] at most, of a recording whose chunks are as they were
        for file in files:
            size = sum(part.lstat().st_size for part in (file, *side_files(file)))
            self._size += size
            self._unpacked_size += size * MAX_PACKING if is_compressed(file) else size
        #: [B] of an unpacked chunk: only a hostile bag is much smaller than its largest message
        self.max_chunk = max(MAX_RECORD, min(self._unpacked_size, MAX_CHUNK))
        self._seconds = max(8.0, self._unpacked_size / (3 << 20))
        self._end = thread_time() + self._seconds if timed else inf
        self._kept: set[int] = set()
        self._kept_bytes = 0
        self.renew()

    def renew(self) -> None:
        """Restart the budget, to read the same files again."""
        self._bytes = 4 * MAX_RECORD + 1000 * self._size
        self._records = 10_000 + self._unpacked_size // 8

    @property
    def is_late(self) -> bool:
        """Whether the time is over."""
        return thread_time() > self._end

    def charge(self, size: int = 0) -> None:
        """Charge a record of `size` unpacked bytes, before the work; UserError: none are left."""
        self._bytes -= size
        self._records -= 1
        # The time is not read for each of many small records.
        is_time_to_look = size > 0 or self._records % 64 == 0
        if (is_time_to_look and self.is_late) or self._bytes < 0 or self._records < 0:
            raise UserError(
                f'{str(self.file)!r} unpacks to more than a recording of its size can hold, or '
                f'takes more than {self._seconds:.0f} s to read: name another bag'
            )

    def keep(self, record: bytes) -> None:
        """Charge a record that stays in memory, with Python's overhead; equal records count once.

        UserError: the bag's records exceed the bound.
        """
        identity = hash(record)
        if identity not in self._kept:
            self._kept.add(identity)
            self._kept_bytes += len(record) + 1000
        if self._kept_bytes > MAX_KEPT:
            excess = f'{self._kept_bytes} bytes of topics, metadata and attached files'
            refuse(self.file, excess, f'{MAX_KEPT}')


def from_json(text: str) -> Any:  # noqa: ANN401 (any JSON)
    """Return the value of a bag's JSON; ValueError: it is invalid, too long or too deep."""
    if len(text) > MAX_TEXT:
        raise ValueError(f'{len(text)} characters')
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError('too many brackets within brackets') from None


def refuse(path: Path, excess: str, maximum: str) -> NoReturn:
    """Raise the UserError for what exceeds a bound."""
    raise UserError(
        f'{str(path)!r} has {excess}, where a run has at most {maximum}: name the bag of a run'
    )
