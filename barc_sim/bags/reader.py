"""Reads a run's bag: its directory -> Log."""

from __future__ import annotations

import logging
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from barc_sim.bags import bounds
from barc_sim.bags.metadata import METADATA_NAME
from barc_sim.bags.records import files, records
from barc_sim.bags.samples import TOPICS, Sample, join
from barc_sim.errors import UserError
from barc_sim.simulation.log import CONTROLLER_STATE, MESSAGE_TYPES, PID_STATE, STATE, recordable

if TYPE_CHECKING:
    from barc_sim.simulation.log import Log

_logger = logging.getLogger(__name__)


def newest(root: Path | str = 'bags') -> Path:
    """Return the bag in the folder `root` that was written to last.

    Raises
    ------
    UserError
        There is no bag.

    Examples
    --------
    >>> newest('bags').is_dir()
    True
    """
    files = [file for file in Path(root).glob('*/*.mcap') if not file.is_symlink()]
    if not files:
        raise UserError(f'there is no bag in {str(root)!r}: make a run first, or name a bag')
    return max(files, key=lambda file: (file.lstat().st_mtime_ns, file)).parent


def info(path: Path | str) -> dict[str, str]:
    """Return the metadata of the run: command line, versions, parameters and the like.

    Raises
    ------
    UserError
        There is no bag at `path`.

    Examples
    --------
    >>> 'parameters' in info(newest('bags'))
    True
    """
    entries: dict[str, str] = {}
    for file in files(Path(path)):
        for record in records(file, messages=False):
            if isinstance(record, Metadata) and record.name == METADATA_NAME:
                entries.update(record.metadata)
    return bounds.check_entries(Path(path), entries)


def attachments(path: Path | str) -> dict[str, bytes]:
    """Return the files attached to the bag, by name.

    Raises
    ------
    UserError
        There is no bag at `path`.
    """
    return {
        record.name: record.data
        for file in files(Path(path))
        for record in records(file, messages=False)
        if isinstance(record, Attachment)
    }


def counts(path: Path | str) -> dict[str, int]:
    """Return the number of messages by topic, without namespaces.

    Raises
    ------
    UserError
        There is no bag at `path`.

    Examples
    --------
    >>> counts(newest('bags'))['ecu']
    1152
    """
    found: dict[str, int] = defaultdict(int)
    for file in files(Path(path)):
        names: dict[int, str] = {}
        for record in records(file):
            if isinstance(record, Channel):
                names[record.id] = record.topic.rpartition('/')[2]
            elif isinstance(record, Message) and record.channel_id in names:
                found[names[record.channel_id]] += 1
    return dict(found)


def read(path: Path | str, namespace: str | None = None) -> Log:
    """Read the run of a car.

    A bag whose run was killed is read up to its last whole record, with a warning in the log.

    Parameters
    ----------
    path
        A bag's directory, or an MCAP file.
    namespace
        The car's, as in `/car1`; needed only where there are several cars.

    Raises
    ------
    UserError
        There is no bag at `path`, or it has no such car, or several.

    Examples
    --------
    >>> from barc_sim import read_bag
    >>> log = read_bag(max(Path('bags').iterdir()))
    >>> len(log)
    1152
    """
    samples = _samples(Path(path))
    wanted = None if namespace is None else '/' + namespace.strip('/')
    cars = [
        car
        for car in sorted(samples, key=_in_order)
        if STATE in samples[car] and wanted in (None, car)
    ]
    if not cars and not sum(counts(path).values()):
        raise UserError(
            f'{str(path)!r} is empty: it has no states, nor any other message; name another'
        )
    if not cars:
        whose = 'of a car' if wanted is None else f'of the car {wanted}'
        raise UserError(
            f'{str(path)!r} has no states {whose} (topic {STATE} of type {MESSAGE_TYPES[STATE]}): '
            'name the bag of a run'
        )
    if len(cars) > 1:
        raise UserError(
            f'{str(path)!r} has several cars, {", ".join(cars)}: name one, as in '
            f'--namespace {cars[0]}'
        )
    return bounds.check_log(Path(path), join(samples[cars[0]]))


def _in_order(namespace: str) -> tuple[int, str]:
    """Return a key that sorts /car10 after /car2."""
    return len(namespace), namespace


class _Decoder:
    """Decodes the messages of the topics that a log is made of, the records of one file."""

    def __init__(self) -> None:
        self.undecodable = 0  # records
        self._types = get_typestore(Stores.EMPTY)
        self._registered: set[tuple[str, bytes]] = set()
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, tuple[str, str]] = {}  # namespace and topic

    def decode(self, record: McapRecord) -> tuple[str, str, Sample] | None:
        """Return namespace, topic and sample, where the record is a message of such a topic."""
        try:
            if isinstance(record, Schema):
                self._schemas[record.id] = record
            elif isinstance(record, Channel):
                self._add(record)
            elif isinstance(record, Message) and record.channel_id in self._channels:
                namespace, _ = self._channels[record.channel_id]
                return (namespace, *self._sample(record))
        except Exception:  # noqa: BLE001 (damage may raise anything)
            self.undecodable += 1
        return None

    def _add(self, channel: Channel) -> None:
        namespace, _, topic = channel.topic.rpartition('/')
        schema = self._schemas.get(channel.schema_id)
        self._channels.pop(channel.id, None)
        if schema and schema.name == MESSAGE_TYPES.get(topic):
            self._register(schema)
            self._channels[channel.id] = namespace or '/', topic

    def _register(self, schema: Schema) -> None:
        """Add a type; the number of definitions is bounded, as parsing one is slow."""
        if (schema.name, schema.data) in self._registered:
            return
        if len(schema.data) > bounds.MAX_SCHEMA or len(self._registered) >= bounds.MAX_SCHEMAS:
            raise ValueError('schema')
        self._registered.add((schema.name, schema.data))
        self._types.register(get_types_from_msg(schema.data.decode(), schema.name))

    def _sample(self, message: Message) -> tuple[str, Sample]:
        _, topic = self._channels[message.channel_id]
        decoded: Any = self._types.deserialize_cdr(message.data, MESSAGE_TYPES[topic])
        stamp = decoded.header.stamp
        named: dict[str, float] = {}
        if topic == CONTROLLER_STATE:
            # As `pid_state`, with terms that the message names in place of a PID's.
            topic = PID_STATE
            terms = dict(zip(decoded.names, decoded.values.tolist(), strict=True))
            named = {name: terms[name] for name in recordable(terms)}
        # A bag of an earlier version may lack a field.
        values = tuple(
            named.pop(field) if field in named else getattr(decoded, field, np.nan)
            for field in TOPICS[topic].fields
        )
        time = stamp.sec * 10**9 + stamp.nanosec
        return topic, Sample(time, message.publish_time, values, tuple(named.items()))


def _samples(path: Path) -> dict[str, dict[str, list[Sample]]]:
    """Return the messages of the topics that a log is made of, by namespace and topic."""
    samples: dict[str, dict[str, list[Sample]]] = defaultdict(lambda: defaultdict(list))
    for file in files(path):
        decoder = _Decoder()
        for record in records(file):
            if decoded := decoder.decode(record):
                namespace, topic, sample = decoded
                samples[namespace][topic].append(sample)
        if decoder.undecodable:
            _logger.warning(
                '%s has %d records that cannot be decoded: left out', file, decoder.undecodable
            )
    return samples
