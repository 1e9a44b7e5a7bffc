"""Converts a bag: to tables of its topics, to another kind of bag, or to a whole one."""

from __future__ import annotations

import csv
import json
import logging
import re
from contextlib import ExitStack
from dataclasses import fields, is_dataclass
from importlib import import_module
from secrets import token_hex
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.convert.converter import ConverterError
from rosbags.convert.converter import convert as convert_bag
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.msg import normalize_msgtype

from barc_sim.bags.contents import Contents, files, selected, types_of
from barc_sim.bags.recording import Span, information, write_metadata
from barc_sim.bags.writer import BagFile, is_being_written
from barc_sim.cli.files import check_plain
from barc_sim.errors import UserError
from barc_sim.simulation.log import COLUMNS, Log

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from rosbags.typesys.store import Typestore

    from barc_sim.bags.contents import McapFile
    from barc_sim.bags.messages import Message

_BAGS = ('ros1', 'sqlite3')
_logger = logging.getLogger(__name__)


def convert(
    path: Path,
    output: Path,
    kind: str,
    topics: Sequence[re.Pattern[str]] = (),
    exclude: Sequence[re.Pattern[str]] = (),
) -> None:
    """Write the `selected` topics to the new folder or file `output`.

    A table has a row for each message: `t`, the time of reception in seconds since the start of
    the bag, that time in nanoseconds since 1970, and each field, `header.stamp.sec`. A topic whose
    messages cannot be decoded is left out, with a warning.

    Raises
    ------
    UserError
        The bag cannot be read, no topic is selected, the output exists, or a library is not
        installed.
    """
    contents = Contents(path)
    contents.complete()
    names = selected([*contents.topics], topics, exclude)
    if not names:
        present = ', '.join(sorted(contents.topics))
        advice = f'choose --topics of {present}' if present else 'name another bag'
        raise UserError(f'{str(path)!r} has no topic to convert: {advice}')
    if output.exists() or output.is_symlink():
        raise UserError(f'{str(output)!r} exists: name a new --output')
    if kind in _BAGS:
        others = [name for name in contents.topics if name not in names]
        types, storage = get_typestore(Stores.ROS2_JAZZY), '' if kind == 'ros1' else kind
        try:
            convert_bag([path], output, storage, 9, None, '', types, None, others, (), (), ())
        except ConverterError as error:
            raise UserError(
                f'{str(path)!r} cannot be converted ({error}): recover it first, or choose --topics'
            ) from None
        return
    write = {'csv': _write_csv, 'parquet': _write_parquet, 'mat': _write_mat}[kind]
    write(output, _rows(contents, names))


def _rows(contents: Contents, names: Sequence[str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the topic and the cells of each message."""
    stores: dict[str, Typestore] = {}
    broken: set[str] = set()
    start = contents.span.start or 0
    for topic, data, received, *_ in contents.in_order():
        name = topic.name
        if name not in names or (name in broken and name not in stores):
            continue
        try:
            if name not in stores:
                store = get_typestore(Stores.EMPTY)
                store.register(types_of(topic))
                stores[name] = store
            kind = normalize_msgtype(topic.type)  # as rosbags names the part of a service
            read = dict(_cells('', stores[name].deserialize_cdr(data, kind)))
        except Exception as error:  # noqa: BLE001 (damage may raise anything)
            if name not in broken:
                _logger.warning('messages of %s [%s] are left out: %s', name, topic.type, error)
            broken.add(name)
        else:
            yield name, {'t': (received - start) / 1e9, 'received': received, **read}


def _cells(prefix: str, message: Any) -> Iterator[tuple[str, Any]]:  # noqa: ANN401 (any type)
    """Yield the names and values of a message's fields; those of messages in it with a dot."""
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

    There must be `v_x`, at whose period the log is; each other column has the value that was
    received last. Times are those of reception.

    Raises
    ------
    UserError
        The bag cannot be read, or a name is no column, topic or field of a number.
    """
    if unknown := ', '.join(fields.keys() - COLUMNS.keys()):
        raise UserError(f'{unknown}: a log has no such column, but {", ".join(COLUMNS)}')
    contents = Contents(path)
    wanted = {column: text.partition('.')[::2] for column, text in fields.items()}
    rows: dict[str, tuple[list[float], list[Any]]] = {column: ([], []) for column in wanted}
    for topic, cells in _rows(contents, [topic for topic, _ in wanted.values()]):
        for column, (name, field) in wanted.items():
            if name == topic and field in cells:
                rows[column][0].append(cells['t'])
                rows[column][1].append(cells[field])
    for column, (times, values) in rows.items():
        if len(times) < 2 or not isinstance(values[0], (int, float)):  # noqa: PLR2004
            raise UserError(
                f'{column}={fields[column]}: {str(path)!r} has no numbers there; '
                f'`barc convert` shows the fields of its topics {", ".join(contents.topics)}'
            )
    seen, speeds = (np.array(each, np.float64) for each in rows['v_x'])
    ts = float(np.median(np.diff(seen)))
    t = ts * np.arange(round((seen[-1] - seen[0]) / ts) + 1)
    never = np.zeros(len(t), np.bool_)
    columns: dict[str, Any] = dict.fromkeys(COLUMNS, np.full(len(t), np.nan))
    for column, (received, values) in rows.items():
        # A command that follows its state at once counts for that state.
        at = np.searchsorted(np.array(received) - seen[0], t + 0.5 * ts) - 1
        columns[column] = np.where(at < 0, np.nan, np.array(values, np.float64)[at])
    columns |= {'t': t, 'v_x': np.interp(t, seen - seen[0], speeds)}
    return Log(**columns | {'missed': never, 'saturated': never})


def _file_name(topic: str) -> str:
    return re.sub(r'[^\w.]', '_', topic.strip('/').replace('/', '.')).lstrip('.')


def _write_csv(output: Path, rows: Iterator[tuple[str, dict[str, Any]]]) -> None:
    """Write a file a topic; a list is JSON in its cell."""
    output.mkdir(parents=True)
    tables: dict[str, Any] = {}
    with ExitStack() as files:
        for topic, cells in rows:
            if topic not in tables:
                file = (output / f'{_file_name(topic)}.csv').open('x', encoding='utf-8', newline='')
                tables[topic] = csv.writer(files.enter_context(file))
                tables[topic].writerow(cells)
            tables[topic].writerow(
                json.dumps(each) if isinstance(each, list) else each for each in cells.values()
            )


def _columns(rows: Iterator[tuple[str, dict[str, Any]]]) -> dict[str, dict[str, list[Any]]]:
    """Return the columns of each topic."""
    tables: dict[str, dict[str, list[Any]]] = {}
    for topic, cells in rows:
        columns = tables.setdefault(topic, {name: [] for name in cells})
        for name, value in cells.items():
            columns[name].append(value)
    return tables


def _write_parquet(output: Path, rows: Iterator[tuple[str, dict[str, Any]]]) -> None:
    pyarrow, parquet = _library('pyarrow', 'parquet'), _library('pyarrow.parquet', 'parquet')
    output.mkdir(parents=True)
    for topic, columns in _columns(rows).items():
        parquet.write_table(pyarrow.table(columns), output / f'{_file_name(topic)}.parquet')


def _write_mat(output: Path, rows: Iterator[tuple[str, dict[str, Any]]]) -> None:
    """Write a struct a topic, with a column of each field; lists of one length are a matrix."""
    scipy = _library('scipy.io', 'matlab')
    structs = {
        re.sub(r'\W', '_', topic.strip('/')): {
            name.replace('.', '_'): _matrix(values) for name, values in columns.items()
        }
        for topic, columns in _columns(rows).items()
    }
    output.parent.mkdir(parents=True, exist_ok=True)
    scipy.savemat(
        output,
        structs,
        appendmat=False,
        long_field_names=True,
        oned_as='column',
        do_compression=True,
    )


def _matrix(values: list[Any]) -> Any:  # noqa: ANN401 (of any element)
    try:
        found = np.array(values)
    except ValueError:  # lists of different lengths
        found = np.empty(0, object)
    if found.dtype.kind in 'biufU':
        return found
    cells = np.empty(len(values), object)
    cells[:] = [each if isinstance(each, str) else np.array(each) for each in values]
    return cells


def _library(name: str, extra: str) -> Any:  # noqa: ANN401 (a module)
    try:
        return import_module(name)
    except ImportError:
        raise UserError(
            f'this format needs {name.partition(".")[0]}: pip install "barc_sim[{extra}]", or '
            'choose another --to'
        ) from None


def recover(path: Path) -> tuple[Contents, list[Path]]:
    """Rewrite the damaged files of a bag, with their summaries, and its metadata.yaml.

    A damaged file is replaced once its successor is whole; if anything in it was unreadable, it is
    kept as `<name>.damaged`. Return what could be read, and the files that were kept. UserError:
    there is no bag, it is still being recorded, nothing in it can be read, or the files cannot be
    written; the bag is unchanged.
    """
    directory = files(path)[0].parent
    check_plain(directory)
    contents = Contents(directory, run=True)
    spans: dict[str, Span] = {}  # by the files' names
    kept = []
    try:
        for file, messages in contents.by_file():
            kept += _recover_file(file, messages, contents, spans)
        write_metadata(directory, _information(contents, spans))
    except OSError as error:
        raise UserError(
            f'{str(directory)!r} cannot be recovered ({error.strerror}): copy it to a folder with '
            'space, and recover it there'
        ) from error
    return contents, kept


def _information(contents: Contents, spans: dict[str, Span]) -> dict[str, Any]:
    topics = contents.topics.items()
    counted = [(topic, count) for name, topic in topics if (count := contents.counts[name])]
    return information(spans, counted, contents.metadata)


def _recover_file(
    file: McapFile, messages: Iterable[Message], contents: Contents, spans: dict[str, Span]
) -> list[Path]:
    """Rewrite a file if it is damaged; return the old one where that is kept."""
    path = file.path
    if is_being_written(path):
        raise UserError(f'{str(path)!r} is being recorded: end the recording first')
    part = path.with_name(f'.{token_hex(8)}.part')
    copy, kept = BagFile(part), []
    try:
        copy.add_metadata(file.metadata)
        for each in file.attachments.values():
            copy.attach(each)
        for message in messages:
            copy.add([message])
            copy.commit()
        copy.end_chunk()
        spans[path.name] = copy.span
        contents.topics |= file.topics
        if file.damage:
            copy.finish(_information(contents, spans))
            copy.commit()
            if file.damage.unreadable_chunks or file.damage.unread:
                kept.append(path.rename(_unused(path)))
            part.replace(path)
    finally:
        copy.appender.close()
        part.unlink(missing_ok=True)
    return kept


def _unused(file: Path) -> Path:
    path, number = file.with_name(f'{file.name}.damaged'), 2
    while path.exists():
        path, number = file.with_name(f'{file.name}.damaged{number}'), number + 1
    return path
