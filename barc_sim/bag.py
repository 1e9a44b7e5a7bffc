"""Reads a run's bag: its directory -> Log."""

from __future__ import annotations

import logging
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.records import Channel, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from barc_sim.bag_directory import METADATA_NAME
from barc_sim.errors import UserError
from barc_sim.samples import STATE, TOPICS, Sample, join

if TYPE_CHECKING:
    from collections.abc import Iterator

    from barc_sim.log import Log

_MAGIC = b'\x89MCAP0\r\n'
_logger = logging.getLogger(__name__)


def newest(root: Path | str = 'bags') -> Path:
    """Return the bag in the folder `root` whose file was written to last.

    Raises
    ------
    UserError
        There is no bag.
    """
    files = list(Path(root).glob('*/*.mcap'))
    if not files:
        raise UserError(f'there is no bag in {str(root)!r}: make a run first, or name a bag')
    return max(files, key=lambda file: (file.stat().st_mtime_ns, file)).parent


def info(path: Path | str) -> dict[str, str]:
    """Return what the run said of itself: command line, versions, parameters and the like.

    Raises
    ------
    UserError
        There is no bag at `path`.
    """
    entries: dict[str, str] = {}
    for file in _files(Path(path)):
        for record in _records(file, messages=False):
            if isinstance(record, Metadata) and record.name == METADATA_NAME:
                entries.update(record.metadata)
    return entries


def read(path: Path | str, namespace: str | None = None) -> Log:
    """Read the run of a car.

    A bag whose run was killed is read as far as it goes, with a warning in the log.

    Parameters
    ----------
    path
        A bag's directory, or an MCAP file.
    namespace
        The car's, as in `/car1`; needed only where there are several cars.

    Raises
    ------
    UserError
        There is no bag at `path`, no car in it, or not one but several.
    """
    samples = _samples(Path(path))
    wanted = None if namespace is None else '/' + namespace.strip('/')
    cars = [car for car in sorted(samples) if STATE in samples[car] and wanted in (None, car)]
    if not cars:
        whose = 'of a car' if wanted is None else f'of the car {wanted}'
        raise UserError(
            f'{str(path)!r} has no states {whose} (topic {STATE} of type {TOPICS[STATE].type}): '
            'name the bag of a run'
        )
    if len(cars) > 1:
        raise UserError(f'{str(path)!r} has several cars, {" and ".join(cars)}: name one of them')
    return join(samples[cars[0]])


def _files(path: Path) -> list[Path]:
    if not path.exists():
        raise UserError(f'there is no bag {str(path)!r}: name the directory of a bag')
    files = sorted(path.glob('*.mcap')) if path.is_dir() else [path]
    if not files:
        raise UserError(f'{str(path)!r} has no .mcap file in it: name the directory of a bag')
    return files


def _records(file: Path, *, messages: bool = True) -> Iterator[McapRecord]:
    """Yield a file's records as far as it is whole, and warn if that is not to its end.

    Without `messages`, only what is outside of the chunks, and no warning.
    """
    try:
        stream = file.open('rb')
    except OSError as error:
        raise UserError(
            f'{str(file)!r} cannot be read ({error.strerror}): name another bag'
        ) from error
    with stream:
        if (magic := stream.read(len(_MAGIC))) != _MAGIC:
            what = 'not an MCAP file' if magic else 'empty'
            raise UserError(f'{str(file)!r} is {what}: name another bag')
        stream.seek(0)
        records = StreamReader(stream, emit_chunks=not messages, validate_crcs=True).records
        try:
            yield from records
        except Exception:  # noqa: BLE001 (damage may raise anything)
            if messages:
                _logger.warning('%s is unfinished or damaged: read as far as it is whole', file)


def _samples(path: Path) -> dict[str, dict[str, list[Sample]]]:
    """Return the messages of the topics that a log is made of, by namespace and topic."""
    types = get_typestore(Stores.EMPTY)
    samples: dict[str, dict[str, list[Sample]]] = defaultdict(lambda: defaultdict(list))
    for file in _files(path):
        schemas: dict[int, Schema] = {}
        channels: dict[int, tuple[str, str]] = {}
        for record in _records(file):
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                namespace, _, topic = record.topic.rpartition('/')
                schema = schemas.get(record.schema_id)
                if schema and topic in TOPICS and schema.name == TOPICS[topic].type:
                    types.register(get_types_from_msg(schema.data.decode(), schema.name))
                    channels[record.id] = namespace or '/', topic
            elif isinstance(record, Message) and record.channel_id in channels:
                namespace, topic = channels[record.channel_id]
                message: Any = types.deserialize_cdr(record.data, TOPICS[topic].type)
                samples[namespace][topic].append(_sample(message, topic, record.publish_time))
    return samples


def _sample(message: Any, topic: str, published: int) -> Sample:  # noqa: ANN401 (any type's)
    stamp = message.header.stamp
    # A bag of an earlier version may lack a field.
    values = tuple(getattr(message, field, np.nan) for field in TOPICS[topic].fields)
    return Sample(stamp.sec * 10**9 + stamp.nanosec, published, values)
