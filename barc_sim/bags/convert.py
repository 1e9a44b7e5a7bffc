"""Converts a bag to tables, and to a log."""

from __future__ import annotations

import csv
import json
import logging
import re
from collections import defaultdict
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, is_dataclass
from dataclasses import fields as fields_of
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.msg import normalize_msgtype

from barc_sim.bags.contents import Contents
from barc_sim.bags.recording_settings import selected
from barc_sim.bags.schemas import types_of
from barc_sim.errors import UserError
from barc_sim.simulation.log import COLUMNS, Log, log_of_columns

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from barc_sim.bags.messages import Topic

_logger = logging.getLogger(__name__)
_REPEATED = 0.1  #: share of messages that may have the time of another
_MAX_NAME = 60  #: characters of a topic in the name of its table: at most 240 bytes


def convert(
    path: Path,
    output: Path,
    topics: Sequence[re.Pattern[str]] = (),
    exclude: Sequence[re.Pattern[str]] = (),
) -> None:
    """Write each topic of a bag to a CSV file in a new folder.

    A table has a row for each message: `t`, the time of reception in seconds since the start of
    the bag, that time in nanoseconds since 1970, and each field, such as `header.stamp.sec`. A list
    is JSON in its cell. A topic whose messages cannot be decoded is left out, with a warning. A
    topic with messages of two types has two tables.

    Parameters
    ----------
    path
        The bag.
    output
        The folder to make.
    topics, exclude
        Which topics to convert, see `selected`.

    Raises
    ------
    UserError
        The bag cannot be read, no selected topic has messages that can be decoded, or the output
        exists.
    """
    contents = Contents(path)
    contents.complete()
    names = selected(contents.names, topics, exclude)
    if not names:
        present = ', '.join(sorted(contents.names))
        advice = f'choose --topics of {present}' if present else 'name another bag'
        raise UserError(f'{str(path)!r} has no topic to convert: {advice}')
    if output.exists() or output.is_symlink():
        raise UserError(f'{str(output)!r} exists: name a new --output')

    output.mkdir(parents=True)
    topics_to_write = [topic for topic in contents.topics if topic.name in names]
    with closing(_Tables(output, topics_to_write)) as tables:
        for topic, cells in _rows(contents, topics_to_write):
            tables.write(topic, cells)
    if not tables.count:
        output.rmdir()
        raise UserError(
            f'{str(path)!r} has no message that can be converted of {", ".join(names)}: choose '
            'other --topics, or name another bag'
        )


class _Tables:
    """The CSV files of topics in a folder; a file is made with its first row."""

    def __init__(self, folder: Path, topics: Sequence[Topic]) -> None:
        self._folder = folder
        file_names = _file_names(topics)
        self._file_names = {id(topic): name for topic, name in zip(topics, file_names, strict=True)}
        self._files = ExitStack()
        self._tables: dict[int, Any] = {}  # by identity of the topic

    @property
    def count(self) -> int:
        """The number of tables with a row."""
        return len(self._tables)

    def write(self, topic: Topic, cells: Mapping[str, Any]) -> None:
        """Add a row to the table of a topic."""
        if id(topic) not in self._tables:
            file = self._folder / self._file_names[id(topic)]
            stream = self._files.enter_context(file.open('x', encoding='utf-8', newline=''))
            self._tables[id(topic)] = csv.writer(stream)
            self._tables[id(topic)].writerow(cells)

        values = cells.values()
        row = [json.dumps(value) if isinstance(value, list) else value for value in values]
        self._tables[id(topic)].writerow(row)

    def close(self) -> None:
        """Close the files."""
        self._files.close()


def _file_names(topics: Sequence[Topic]) -> Iterator[str]:
    """Yield the file name of each topic's table; a name that another topic has gets a `_` more.

    Upper and lower case count as the same, as on a Mac.
    """
    used = set()
    for topic in topics:
        dotted = topic.name.strip('/').replace('/', '.')
        name = re.sub(r'[^\w.]', '_', dotted).lstrip('.')[:_MAX_NAME]
        while name.casefold() in used:
            name += '_'
        used.add(name.casefold())
        yield f'{name}.csv'


def _rows(contents: Contents, topics: Sequence[Topic]) -> Iterator[tuple[Topic, dict[str, Any]]]:
    """Yield the topic and the cells of each message of `topics`, which are of `contents`."""
    decoders: dict[int, _AnyDecoder | None] = {}  # by identity of the topic; None: undecodable
    identities = {id(topic) for topic in topics}
    unreadable: set[int] = set()
    start = contents.span.start or 0
    for message in contents.in_order():
        topic = message.topic
        identity = id(topic)
        if identity not in identities:
            continue
        try:
            if identity not in decoders:
                decoders[identity] = None
                decoders[identity] = _AnyDecoder(topic)
            decoder = decoders[identity]
            if decoder is None:
                continue
            cells = dict(_cells('', decoder.decode(message.data)))
        except Exception as error:  # noqa: BLE001 (damage may raise anything)
            if identity not in unreadable:
                unreadable.add(identity)
                kind = topic.type or 'no schema'
                _logger.warning('messages of %s [%s] are left out: %s', topic.name, kind, error)
            continue

        times = {'t': (message.received - start) / 1e9, 'received': message.received}
        yield topic, times | cells


class _AnyDecoder:
    """Decodes the messages of a topic of any type."""

    def __init__(self, topic: Topic) -> None:
        self._store = get_typestore(Stores.EMPTY)
        self._store.register(types_of(topic))
        self._type = topic.type
        if self._type not in self._store.fielddefs:
            # rosbags has its own name for a part of a service.
            self._type = normalize_msgtype(self._type)

    def decode(self, data: bytes) -> Any:  # noqa: ANN401 (of the topic's type)
        """Return a message; an exception: `data` is damaged."""
        return self._store.deserialize_cdr(data, self._type)


def _cells(prefix: str, message: Any) -> Iterator[tuple[str, Any]]:  # noqa: ANN401 (any type)
    """Yield the names and values of a message's fields; nested fields have a dot in the name."""
    for part in fields_of(message):
        if part.name.startswith('__') or part.name.isupper():  # rosbags' own, or a constant
            continue
        name = f'{prefix}{part.name}'
        value = getattr(message, part.name)
        if is_dataclass(value):
            yield from _cells(f'{name}.', value)
        else:
            yield name, _plain(value)


def _plain(value: Any) -> Any:  # noqa: ANN401 (any type)
    """Return a value in JSON's types."""
    if is_dataclass(value):
        return dict(_cells('', value))
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list):
        return [_plain(element) for element in value]
    return value


def log_of_fields(path: Path, fields: Mapping[str, str]) -> Log:
    """Return the log of any car, from the fields of any topics.

    The log has a row for each time at which a message was received, with the fields of that
    message; the others are NaN. Its times are since the first `v_x`, which is required.

    Parameters
    ----------
    path
        The bag.
    fields
        For each column by name, topic and field, such as `/odom.pose.x`.

    Raises
    ------
    UserError
        The bag cannot be read, there is no such column, topic or field of numbers, or most times of
        `v_x` repeat.
    """
    unknown = ', '.join(fields.keys() - COLUMNS.keys())
    if unknown:
        raise UserError(f'{unknown}: a log has no such column; it has {", ".join(COLUMNS)}')

    series = _read_series(path, fields)
    times_of_speed = series['v_x'].times
    repeated = len(times_of_speed) - len(set(times_of_speed))
    if repeated > _REPEATED * len(times_of_speed):
        raise UserError(
            f'v_x={fields["v_x"]}: {repeated} of {len(times_of_speed)} messages share their time: '
            'record with a finer clock'
        )

    times = sorted(set().union(*(column.times for column in series.values())))
    row_at = {time: row for row, time in enumerate(times)}
    start = times_of_speed[0]
    columns: dict[str, Any] = {'t': np.array([(time - start) / 1e9 for time in times])}
    for name, column in series.items():
        rows = [row_at[time] for time in column.times]
        columns[name] = np.full(len(times), np.nan)
        columns[name][rows] = column.values
    return log_of_columns(Log, columns)


@dataclass
class _Series:
    """The values of a field over time."""

    times: list[int] = field(default_factory=list)  #: [ns] of reception
    values: list[Any] = field(default_factory=list)


def _read_series(path: Path, fields: Mapping[str, str]) -> dict[str, _Series]:
    """Read the series of each column; UserError: a field has no numbers."""
    contents = Contents(path)
    columns_of_topic: defaultdict[str, dict[str, str]] = defaultdict(dict)
    for column, text in fields.items():
        topic_name, _, field_name = text.partition('.')
        columns_of_topic[topic_name][column] = field_name

    series = {column: _Series() for column in fields}
    topics = [topic for topic in contents.topics if topic.name in columns_of_topic]
    for topic, cells in _rows(contents, topics):
        for column, field_name in columns_of_topic[topic.name].items():
            if field_name in cells:
                series[column].times.append(cells['received'])
                series[column].values.append(cells[field_name])

    for column, of_column in series.items():
        if len(of_column.times) < 2 or not _are_numbers(of_column.values):  # noqa: PLR2004
            raise UserError(
                f'{column}={fields[column]}: {str(path)!r} has no numbers in this field; '
                f'`barc convert` shows the fields of its topics {", ".join(contents.names)}'
            )
    return series


def _are_numbers(values: list[Any]) -> bool:
    return all(isinstance(value, (int, float)) for value in values)
