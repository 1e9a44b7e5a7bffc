"""Converts a bag to tables, to a log, and a damaged bag to a whole one."""

from __future__ import annotations

import csv
import json
import logging
import re
import shutil
from contextlib import ExitStack, closing
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.msg import normalize_msgtype

from barc_sim.bags.contents import Contents
from barc_sim.bags.recording import make_directory, selected
from barc_sim.bags.schemas import types_of
from barc_sim.bags.writer import BagWriter
from barc_sim.errors import UserError
from barc_sim.simulation.log import COLUMNS, Log, log_of_columns

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from rosbags.typesys.store import Typestore

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
    """Write each of the `selected` topics to a CSV file in the new folder `output`.

    A table has a row for each message: `t`, the time of reception in seconds since the start of
    the bag, that time in nanoseconds since 1970, and each field, such as `header.stamp.sec`. A list
    is JSON in its cell. A topic whose messages cannot be decoded is left out, with a warning.

    A topic with messages of two types has two tables.

    UserError: the bag cannot be read, no selected topic has messages that can be decoded, or the
    output exists.
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
    chosen = [topic for topic in contents.topics if topic.name in names]
    file_names = dict(zip(map(id, chosen), _file_names(chosen), strict=True))
    tables: dict[int, Any] = {}  # by identity of the topic
    with ExitStack() as files:
        for topic, cells in _rows(contents, chosen):
            table = tables.get(id(topic))
            if table is None:
                file = (output / file_names[id(topic)]).open('x', encoding='utf-8', newline='')
                table = tables[id(topic)] = csv.writer(files.enter_context(file))
                table.writerow(cells)
            table.writerow(
                json.dumps(each) if isinstance(each, list) else each for each in cells.values()
            )
    if not tables:
        output.rmdir()
        raise UserError(
            f'{str(path)!r} has no message that can be converted of {", ".join(names)}: choose '
            'other --topics, or name another bag'
        )


def _file_names(topics: Sequence[Topic]) -> Iterator[str]:
    """Yield the file name of each topic's table; a name that is taken gets a `_` more.

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
    wanted = {id(topic) for topic in topics}
    stores: dict[int, Typestore] = {}
    broken: set[int] = set()
    start = contents.span.start or 0
    for message in contents.in_order():
        topic = message.topic
        identity = id(topic)
        if identity not in wanted or (identity in broken and identity not in stores):
            continue
        try:
            if identity not in stores:
                store = get_typestore(Stores.EMPTY)
                store.register(types_of(topic))
                stores[identity] = store
            store, kind = stores[identity], topic.type
            if kind not in store.fielddefs:  # rosbags has its own name for a part of a service
                kind = normalize_msgtype(kind)
            read = dict(_cells('', store.deserialize_cdr(message.data, kind)))
        except Exception as error:  # noqa: BLE001 (damage may raise anything)
            if identity not in broken:
                _logger.warning(
                    'messages of %s [%s] are left out: %s',
                    topic.name,
                    topic.type or 'no schema',
                    error,
                )
            broken.add(identity)
        else:
            t = (message.received - start) / 1e9
            yield topic, {'t': t, 'received': message.received, **read}


def _cells(prefix: str, message: Any) -> Iterator[tuple[str, Any]]:  # noqa: ANN401 (any type)
    """Yield the names and values of a message's fields; nested fields have a dot in the name."""
    for field in fields(message):
        if field.name.startswith('__') or field.name.isupper():  # rosbags' own, or a constant
            continue
        name, value = f'{prefix}{field.name}', getattr(message, field.name)
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
    return [_plain(each) for each in value] if isinstance(value, list) else value


def log_of_fields(path: Path, fields: Mapping[str, str]) -> Log:
    """Return the log of any car: columns by name, each from a field such as `/odom.pose.x`.

    The log has a row for each time at which a message was received, with the fields of that
    message; the others are NaN. Its times are since the first `v_x`, which is required.

    UserError: the bag cannot be read, there is no such column, topic or field of numbers, or most
    times of `v_x` repeat.
    """
    if unknown := ', '.join(fields.keys() - COLUMNS.keys()):
        raise UserError(f'{unknown}: a log has no such column; it has {", ".join(COLUMNS)}')
    contents = Contents(path)
    wanted = {column: text.partition('.')[::2] for column, text in fields.items()}
    rows: dict[str, tuple[list[int], list[Any]]] = {column: ([], []) for column in wanted}
    names = {name for name, _ in wanted.values()}
    for topic, cells in _rows(contents, [each for each in contents.topics if each.name in names]):
        for column, (name, field) in wanted.items():
            if name == topic.name and field in cells:
                rows[column][0].append(cells['received'])
                rows[column][1].append(cells[field])
    for column, (times, values) in rows.items():
        if len(times) < 2 or not _are_numbers(values):  # noqa: PLR2004
            raise UserError(
                f'{column}={fields[column]}: {str(path)!r} has no numbers in this field; '
                f'`barc convert` shows the fields of its topics {", ".join(contents.names)}'
            )
    received, _ = rows['v_x']
    repeated = len(received) - len(set(received))
    if repeated > _REPEATED * len(received):
        raise UserError(
            f'v_x={fields["v_x"]}: {repeated} of {len(received)} messages share their time: '
            'record with a finer clock'
        )
    times = sorted({time for each, _ in rows.values() for time in each})
    row_at = {time: row for row, time in enumerate(times)}
    columns: dict[str, Any] = {'t': np.array([(time - received[0]) / 1e9 for time in times])}
    for column, (each, values) in rows.items():
        columns[column] = np.full(len(times), np.nan)
        columns[column][[row_at[time] for time in each]] = values
    return log_of_columns(Log, columns)


def _are_numbers(values: list[Any]) -> bool:
    return all(isinstance(value, (int, float)) for value in values)


def recover(path: Path, output: Path) -> Contents:
    """Copy all readable messages of a bag to the new directory `output`; return what was read.

    Schemas, channels and encodings are written as they were read.

    UserError: there is no bag, nothing in it can be read, or the output exists or cannot be
    written.
    """
    contents = Contents(path, timed=True)
    make_directory(output, output.parent)
    try:
        with closing(BagWriter(output, metadata=contents.metadata)) as writer:
            writer.attach(contents.attachments)
            for message in contents.messages():
                writer.write([message])
    except (OSError, UserError) as error:
        shutil.rmtree(output)
        if isinstance(error, UserError):
            raise
        raise UserError(
            f'{str(output)!r} cannot be written ({error.strerror}): name an --output on a disk '
            'with space'
        ) from error
    return contents
