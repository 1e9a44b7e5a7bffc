"""Bags with the files, tables and metadata.yaml that each version of rosbag2 writes.

The names of the entries and their order are those of its `BagMetadata` on each branch; the tables
are those of its plugin for sqlite3.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import yaml
import zstandard
from mcap.writer import CompressionType, Writer

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

_ENDLESS = '{sec: 2147483647, nsec: 4294967295}'
#: QoS up to version 8: a text with numbers.
_NUMBERED_QOS = f"""- history: 3
  depth: 0
  reliability: 1
  durability: 1
  deadline: {_ENDLESS}
  lifespan: {_ENDLESS}
  liveliness: 1
  liveliness_lease_duration: {_ENDLESS}
  avoid_ros_namespace_conventions: false"""
#: QoS from version 9 on: a list with names.
_NAMED_QOS = [
    {
        'history': 'unknown',
        'depth': 0,
        'reliability': 'reliable',
        'durability': 'transient_local',
        'deadline': {'sec': 9223372036, 'nsec': 854775807},
        'lifespan': {'sec': 9223372036, 'nsec': 854775807},
        'liveliness': 'automatic',
        'liveliness_lease_duration': {'sec': 9223372036, 'nsec': 854775807},
        'avoid_ros_namespace_conventions': False,
    }
]
_TABLES = """
    CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
      serialization_format TEXT NOT NULL{qos}{hash});
    CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
      timestamp INTEGER NOT NULL, data BLOB NOT NULL);
    CREATE INDEX timestamp_idx ON messages (timestamp ASC);
"""
_SCHEMA_TABLES = """
    CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
    CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL,
      metadata TEXT NOT NULL);
"""
_DEFINITIONS_TABLE = """
    CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL,
      encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL,
      type_description_hash TEXT NOT NULL);
"""


@dataclass(frozen=True)
class Layout:
    """What a distribution of ROS 2 writes."""

    version: int  #: of metadata.yaml
    storages: Sequence[str] = ('sqlite3', 'mcap')
    is_compressing: bool = True


#: By distribution; Jazzy's is Kilted's and Rolling's, too.
LAYOUTS = {
    'crystal': Layout(1, ['sqlite3'], is_compressing=False),
    'eloquent': Layout(2, ['sqlite3'], is_compressing=False),
    'foxy in development': Layout(3, ['sqlite3']),
    'foxy': Layout(4, ['sqlite3']),
    'humble': Layout(5),
    'iron in development': Layout(6),
    'iron': Layout(7),
    'jazzy in development': Layout(8),
    'jazzy': Layout(9),
}
#: What a user has added with --custom-data, from Iron on.
CUSTOM_DATA = {'driver': 'Zoë', 'notes': 'wet road\n\nsecond lap'}
WORDS = 'std_msgs/msg/String'
HASH = 'RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18'


@dataclass(frozen=True)
class Sent:
    """A message that a bag is made of: a word."""

    topic: str
    received: int  #: [ns]
    word: str

    @property
    def data(self) -> bytes:
        """The message in CDR."""
        text = self.word.encode() + b'\0'
        return b'\0\1\0\0' + len(text).to_bytes(4, 'little') + text


def write_bag(
    folder: Path,
    files: Sequence[Sequence[Sent]],
    distribution: str = 'jazzy',
    storage: str = 'mcap',
    compression: str = '',
) -> Path:
    """Write a bag of one file for each sequence of messages, and return its folder.

    Parameters
    ----------
    folder
        The folder to make.
    files
        The messages of each file.
    distribution
        A key of `LAYOUTS`.
    storage
        `mcap` or `sqlite3`.
    compression
        What is compressed: `file`, `message` or nothing.
    """
    version = LAYOUTS[distribution].version
    folder.mkdir()
    paths = []
    for number, messages in enumerate(files):
        suffix = {'mcap': 'mcap', 'sqlite3': 'db3'}[storage]
        path = folder / f'{folder.name}_{number}.{suffix}'
        pack = zstandard.compress if compression == 'message' else bytes
        rows = [(message.topic, message.received, pack(message.data)) for message in messages]
        if storage == 'mcap':
            _write_mcap(path, rows, version)
        else:
            _write_sqlite(path, rows, version)
        if compression == 'file':
            packed = path.with_name(path.name + '.zstd')
            packed.write_bytes(zstandard.compress(path.read_bytes()))
            path.unlink()
            path = packed
        paths.append(path)

    information = _information(paths, files, version, storage, compression)
    text = yaml.safe_dump({'rosbag2_bagfile_information': information}, sort_keys=False)
    (folder / 'metadata.yaml').write_text(text)
    return folder


def _write_mcap(path: Path, rows: Sequence[tuple[str, int, bytes]], version: int) -> None:
    with path.open('wb') as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start('ros2', 'libmcap 1.1.0')
        schema = writer.register_schema(WORDS, 'ros2msg', b'string data\n')
        qos: Any = _NUMBERED_QOS if version < 9 else yaml.safe_dump(_NAMED_QOS)
        channels: dict[str, int] = {}
        for number, (name, received, data) in enumerate(rows):
            if name not in channels:
                metadata = {'offered_qos_profiles': qos}
                channels[name] = writer.register_channel(name, 'cdr', schema, metadata)
            writer.add_message(channels[name], received, data, received, number)
        writer.finish()  # type: ignore[no-untyped-call]


def _write_sqlite(path: Path, rows: Sequence[tuple[str, int, bytes]], version: int) -> None:
    has_qos = version >= 4
    has_hash = version >= 7
    tables = _TABLES.format(
        qos=', offered_qos_profiles TEXT NOT NULL' if has_qos else '',
        hash=', type_description_hash TEXT NOT NULL' if has_hash else '',
    )
    if version >= 5:
        tables += _SCHEMA_TABLES
    if has_hash:
        tables += _DEFINITIONS_TABLE
    topics = list(dict.fromkeys(name for name, _, _ in rows))
    with closing(sqlite3.connect(path)) as database:
        database.executescript(tables)
        if version >= 5:
            schema = (4, 'jazzy') if has_hash else (3, 'humble')
            database.execute('INSERT INTO schema VALUES (?, ?)', schema)
        if has_hash:
            definition = (1, WORDS, 'ros2msg', 'string data\n', HASH)
            database.execute('INSERT INTO message_definitions VALUES (?, ?, ?, ?, ?)', definition)
        for number, name in enumerate(topics, start=1):
            values: list[Any] = [number, name, WORDS, 'cdr']
            if has_qos:
                values.append(_NUMBERED_QOS if version < 9 else yaml.safe_dump(_NAMED_QOS))
            if has_hash:
                values.append(HASH)
            places = ', '.join('?' * len(values))
            database.execute(f'INSERT INTO topics VALUES ({places})', values)  # noqa: S608
        for name, received, data in rows:
            row = (topics.index(name) + 1, received, data)
            database.execute(
                'INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)', row
            )
        database.commit()


def _information(
    paths: Sequence[Path],
    files: Sequence[Sequence[Sent]],
    version: int,
    storage: str,
    compression: str,
) -> dict[str, Any]:
    """Return the content of metadata.yaml."""
    messages = [message for file in files for message in file]
    names = [path.name for path in paths]
    if version < 4:
        names = [f'{path.parent.name}/{path.name}' for path in paths]

    topics = []
    for name in dict.fromkeys(message.topic for message in messages):
        topic: dict[str, Any] = {'name': name, 'type': WORDS, 'serialization_format': 'cdr'}
        if version >= 4:
            topic['offered_qos_profiles'] = _NUMBERED_QOS if version < 9 else _NAMED_QOS
        if version >= 7:
            topic['type_description_hash'] = HASH
        count = sum(message.topic == name for message in messages)
        topics.append({'topic_metadata': topic, 'message_count': count})

    head = {'version': version, 'storage_identifier': storage}
    paths_entry = {'relative_file_paths': names}
    information = head | ({} if version >= 5 else paths_entry)
    information |= _span(messages)
    information['topics_with_message_count'] = topics
    if version >= 3:
        information['compression_format'] = 'zstd' if compression else ''
        information['compression_mode'] = compression.upper()
    information |= paths_entry
    if version >= 5:
        information['files'] = [
            {'path': name, **_span(file)} for name, file in zip(names, files, strict=True)
        ]
    if version >= 6:
        information['custom_data'] = CUSTOM_DATA
    if version >= 8:
        information['ros_distro'] = 'jazzy'
    return information


def _span(messages: Sequence[Sent]) -> dict[str, Any]:
    times = [message.received for message in messages]
    return {
        'starting_time': {'nanoseconds_since_epoch': min(times)},
        'duration': {'nanoseconds': max(times) - min(times)},
        'message_count': len(times),
    }


def write_bomb(folder: Path, suffix: str) -> None:
    """Write a bag of one compressed file, which begins as one of MCAP and unpacks to 1.6 GB."""
    folder.mkdir()
    compressor = zstandard.ZstdCompressor().compressobj()
    head = b'\x89MCAP0\r\n\x80' + (1 << 24).to_bytes(8, 'little')
    record = bytes(1 << 24) + b'\x80' + (1 << 24).to_bytes(8, 'little')
    parts = [compressor.compress(head)]
    parts += [compressor.compress(record) for _ in range(100)]
    parts.append(compressor.flush())
    (folder / f'bomb_0.{suffix}.zstd').write_bytes(b''.join(parts))


def write_endless_database(folder: Path) -> None:
    """Write a bag in sqlite3 of 16 pages that refer 40 times to the next one: of 40^16 rows."""
    write_bag(folder, [[Sent('/a', 1, 'word')]], storage='sqlite3')
    file = folder / f'{folder.name}_0.db3'
    with closing(sqlite3.connect(file)) as database:
        database.execute('DROP INDEX timestamp_idx')
        database.commit()
        query = "SELECT rootpage FROM sqlite_master WHERE name = 'messages'"
        (root,) = database.execute(query).fetchone()

    size = 4096  # of a page
    content = bytearray(file.read_bytes())
    leaf = content[size * (root - 1) : size * root]
    count = len(content) // size
    for number in range(16):
        child = (count + number + 2).to_bytes(4, 'big')
        cells = b''.join(child + bytes([row]) for row in range(40))
        begin = size - len(cells)
        head = bytes([5, 0, 0, 0, 40]) + begin.to_bytes(2, 'big') + b'\0' + child
        pointers = b''.join((begin + 5 * row).to_bytes(2, 'big') for row in range(40))
        content += (head + pointers).ljust(begin, b'\0') + cells
    content += leaf
    content[size * (root - 1) : size * root] = content[size * count : size * (count + 1)]
    content[28:32] = (len(content) // size).to_bytes(4, 'big')
    file.write_bytes(content)
