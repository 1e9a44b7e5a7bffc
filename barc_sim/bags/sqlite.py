"""Reads one file of a bag in sqlite3, rosbag2's storage up to Humble, whole or damaged.

The database is opened for reading alone. What a killed recorder left beside it, a write-ahead log
or a journal, changes a database that is opened: then a copy is read, as of a compressed file.
"""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from contextlib import ExitStack, closing, contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO
from urllib.parse import quote

import zstandard
from mcap.records import Channel, Schema
from rosbags.typesys import Stores, get_typestore

from barc_sim.bags.bag_files import COMPRESSED, Damage, is_compressed, open_storage, side_files
from barc_sim.bags.messages import ROS2MSG, BagMessage, Topic
from barc_sim.bags.metadata import Span
from barc_sim.errors import UserError
from barc_sim.interfaces.definitions import definition

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator

    from rosbags.typesys.store import Typestore

    from barc_sim.bags.bag_files import FilledContents
    from barc_sim.bags.bounds import Budget

#: The columns of each table; the last two of `topics` came with Foxy and with Iron.
_COLUMNS = {
    'topics': ('id', 'name', 'type', 'serialization_format'),
    'messages': ('topic_id', 'timestamp', 'data'),
    'message_definitions': ('topic_type', 'encoding', 'encoded_message_definition'),
}
_QOS = 'offered_qos_profiles'
_HASH = 'type_description_hash'
_SUPER_JOURNAL = bytes.fromhex('d9d505f920a163d7')  # ends a journal that names another file
_STEPS = 100_000  # of sqlite, between two looks at what it has taken
_STEPS_PER_BYTE = 4  # of the file, at most: a row takes 20 steps, and has 30 bytes with its index
_MAX_ROW = 2**62
_BLOCK = 16 << 20  # [B] copied at a time
_RESERVE = 64 << 20  # [B] that a copy leaves free on its disk


class SqliteFile:
    """A file of a bag: adds its topics to the bag, and yields its messages.

    Parameters
    ----------
    path
        The file.
    bag
        The contents of the bag, to which the file adds.
    budget
        Limits the reading of all files of the bag.
    is_alone
        Whether the bag has no other file.

    Raises
    ------
    UserError
        It cannot be read or copied, it exceeds a bound, or it `is_alone` and is no bag.
    """

    attachment_names = ()  #: a database has no attached files

    def __init__(self, path: Path, bag: FilledContents, budget: Budget, *, is_alone: bool) -> None:
        self.path = path
        self.has_summary = False
        self.damage = Damage()
        self.span = Span()
        self._budget = budget
        self._topics: dict[int, Topic] = {}
        self._turns = 0  # of `_STEPS`, that an opened database may still take
        try:
            with self._open() as database:
                self._read_topics(database, bag)
                self._read_span(database)
        except sqlite3.Error as error:
            budget.charge(1)  # the time may be over
            self.damage.unfinished = True
            if is_alone and not self._topics:
                raise UserError(
                    f'{str(path)!r} is not a bag in sqlite3 ({error}): name another bag'
                ) from None

    def messages(self, start: int | None = None) -> Iterator[BagMessage]:
        """Yield the messages in the order of the file.

        Parameters
        ----------
        start
            The time [ns] from which on messages are read; None: all are.
        """
        self.damage = Damage()
        try:
            with self._open() as database:
                _check_columns(database, 'messages')
                for topic_id, received, data in self._rows(database, start):
                    topic = self._topics.get(topic_id)
                    if not isinstance(data, bytes) or not isinstance(received, int):
                        self.damage.unreadable_chunks += 1
                    elif topic is not None:
                        yield BagMessage(topic, data, received, received, 0)
        except sqlite3.Error:
            self._budget.charge(1)
            self.damage.unfinished = True

    def blocks_before(
        self, end: int, wants: Callable[[Collection[int], int], bool]
    ) -> Iterator[Iterator[BagMessage]]:
        """Yield the messages before a time [ns] in one block, if it is wanted."""
        if wants({id(topic) for topic in self._topics.values()}, end):
            yield (message for message in self.messages() if message.received < end)

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        """Provide the database, or a copy of it."""
        beside = side_files(self.path)
        with ExitStack() as end:
            if beside or is_compressed(self.path):
                folder = Path(end.enter_context(tempfile.TemporaryDirectory(prefix='barc_')))
                file = folder / self.path.name.removesuffix(COMPRESSED)
                for source in (self.path, *beside):
                    self._copy(source, folder / source.name.removesuffix(COMPRESSED))
                options = ''
            else:
                open_storage(self.path).stream.close()  # a regular file
                file = self.path.absolute()
                options = '?mode=ro&immutable=1'

            uri = f'file:{quote(str(file))}{options}'
            database = sqlite3.connect(uri, uri=True, check_same_thread=False)
            end.enter_context(closing(database))
            self._turns = 10 + file.stat().st_size * _STEPS_PER_BYTE // _STEPS
            database.set_progress_handler(self._takes_too_long, _STEPS)
            database.text_factory = _text
            database.execute('PRAGMA trusted_schema = OFF')
            database.execute('PRAGMA writable_schema = ON')  # reads a file whose end is missing
            database.execute('PRAGMA query_only = ON')
            yield database

    def _takes_too_long(self) -> bool:
        """Whether to interrupt sqlite: pages that refer to one another can have no end."""
        self._turns -= 1
        return self._turns < 0 or self._budget.is_late

    def _copy(self, source: Path, target: Path) -> None:
        """Copy or unpack a file; UserError: there is no space for it."""
        with open_storage(source).stream as stream, target.open('wb') as copy:
            end = b''
            block = self._block(stream)
            while block:
                free = shutil.disk_usage(target.parent).free
                if free < len(block) + _RESERVE:
                    raise UserError(
                        f'{str(source)!r} is copied to be read, and {str(target.parent.parent)!r} '
                        f'has only {free >> 20} MiB free: name a folder on a larger disk in TMPDIR'
                    )
                copy.write(block)
                end = (end + block)[-len(_SUPER_JOURNAL) :]
                block = self._block(stream)
            if source.name.endswith('-journal') and end == _SUPER_JOURNAL:
                raise sqlite3.DatabaseError('its journal names another file')

    def _block(self, stream: BinaryIO) -> bytes:
        """Return the next block of a file; it is empty at the end, or where it is damaged."""
        block = b''
        try:
            block = stream.read(_BLOCK)
        except zstandard.ZstdError:
            self.damage.unfinished = True
        self._budget.charge(len(block))
        return block

    def _read_topics(self, database: sqlite3.Connection, bag: FilledContents) -> None:
        """Add the topics to the bag."""
        present = _check_columns(database, 'topics')
        qos = _QOS if _QOS in present else "''"
        type_hash = _HASH if _HASH in present else "''"
        definitions = self._read_definitions(database)
        query = f'SELECT id, name, type, serialization_format, {qos}, {type_hash} FROM topics'  # noqa: S608 (names of columns)
        for row in database.execute(query):
            self._budget.keep(repr(row).encode(errors='replace'))
            number = row[0]
            name, kind, encoding, profiles, digest = map(str, row[1:])
            schema = definitions.get(kind) or _schema_without_definition(kind)
            channel = Channel(
                id=0,
                topic=name,
                message_encoding=encoding,
                metadata={_QOS: profiles, 'topic_type_hash': digest},
                schema_id=0,
            )
            self._topics[number] = bag.topic(channel, schema)

    def _read_definitions(self, database: sqlite3.Connection) -> dict[str, Schema]:
        """Return the definitions of types by name; none in a bag up to Humble."""
        schemas: dict[str, Schema] = {}
        table = 'message_definitions'
        query = 'SELECT name FROM sqlite_master WHERE name = ?'
        if not database.execute(query, [table]).fetchall():
            return schemas

        _check_columns(database, table)
        columns = ', '.join(_COLUMNS[table])
        for row in database.execute(f'SELECT {columns} FROM {table}'):  # noqa: S608
            kind, encoding, text = map(str, row)
            data = text.encode(errors='replace')
            self._budget.keep(data)
            if text:
                schemas[kind] = Schema(id=0, name=kind, encoding=encoding, data=data)
        return schemas

    def _read_span(self, database: sqlite3.Connection) -> None:
        """Read the number of messages and their first and last time."""
        _check_columns(database, 'messages')
        row = database.execute('SELECT min(timestamp), max(timestamp), count(*) FROM messages')
        start, end, count = row.fetchone()
        if isinstance(start, int) and isinstance(end, int):
            self.span = Span(start, end, count)
        elif count:
            raise sqlite3.DatabaseError('its times are no integers')
        self.has_summary = True

    def _rows(
        self, database: sqlite3.Connection, start: int | None
    ) -> Iterator[tuple[Any, Any, Any]]:
        """Yield topic, time and data of each row, without those on damaged pages."""
        query = (
            'SELECT rowid, topic_id, timestamp, CASE WHEN length(data) <= ? THEN data END '
            'FROM messages WHERE rowid > ? AND timestamp >= ? ORDER BY rowid'
        )
        earliest = -_MAX_ROW if start is None else start
        last = 0
        step = 1
        while last < _MAX_ROW:
            try:
                for row, topic, received, data in database.execute(
                    query, (self._budget.max_chunk, last, earliest)
                ):
                    last = row
                    step = 1
                    self._budget.charge(len(data) if isinstance(data, bytes) else 0)
                    yield topic, received, data
            except sqlite3.DatabaseError:  # noqa: PERF203
                self._budget.charge(1)
                self.damage.unfinished = True
                # The next row that can be read may be far behind the damaged page.
                last += step
                step *= 2
            else:
                return


def _text(data: bytes) -> str:
    return data.decode(errors='replace')


def _check_columns(database: sqlite3.Connection, table: str) -> set[str]:
    """Return the columns of a table; DatabaseError: it computes its rows, or is not rosbag2's."""
    query = 'SELECT type, rootpage FROM sqlite_master WHERE name = ?'
    kind, page = database.execute(query, [table]).fetchone() or ('', 0)
    columns = set()
    is_computed = False
    for _, name, _, _, _, _, hidden in database.execute(f'PRAGMA table_xinfo({table})'):
        columns.add(name)
        is_computed |= bool(hidden)
    if kind != 'table' or not page or is_computed or not columns.issuperset(_COLUMNS[table]):
        raise sqlite3.DatabaseError(f'it has no table {table!r} of rosbag2')
    return columns


def _schema_without_definition(name: str) -> Schema:
    """Return the schema of a type whose definition the bag lacks: Humble's, or the installed one.

    A type that is not known has a schema without definition.
    """
    with suppress(Exception):  # any name can be in a bag
        return Schema(id=0, name=name, encoding=ROS2MSG, data=_old_definition(name).encode())
    return Schema(id=0, name=name, encoding='', data=b'')


@cache
def _humble() -> Typestore:
    return get_typestore(Stores.ROS2_HUMBLE)


def _old_definition(name: str) -> str:
    """Return a definition; LookupError: there is none."""
    if name in _humble().fielddefs:
        text, _ = _humble().generate_msgdef(name, ros_version=2)
        return text
    return definition(name)
