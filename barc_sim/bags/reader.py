"""Reads the bag of a run: from its directory to a `Bag`, and from that to a `Log`."""

from __future__ import annotations

import json
import logging
from array import array
from collections import defaultdict
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from struct import Struct
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from rosbags.typesys import Stores, get_typestore

from barc_sim.bags import bounds
from barc_sim.bags.contents import Contents, types_of
from barc_sim.bags.parameters import EVENT_TYPE, ParameterHistory
from barc_sim.bags.recording import TRACK_NAME
from barc_sim.control.lane import LANE
from barc_sim.errors import UserError
from barc_sim.interfaces.definitions import store
from barc_sim.interfaces.nodes import CONTROLLER, SIMULATOR
from barc_sim.interfaces.stamps import to_nanoseconds
from barc_sim.interfaces.topics import (
    APPLIED_COMMAND,
    CONTROLLER_STATE,
    ECU,
    LANE_STATE,
    LOG_TYPES,
    PARAMETER_EVENTS,
    PID_STATE,
    STATE,
)
from barc_sim.simulation.log import (
    Flags,
    Floats,
    Log,
    TrackLog,
    columns_of,
    log_of_columns,
    recordable,
)
from barc_sim.vehicle.parameters import LIVE
from barc_sim.vehicle.road import STEEPEST_DEG
from barc_sim.vehicle.track import Pose, Track

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from numpy.typing import NDArray

    from barc_sim.bags.messages import Message, Topic

_logger = logging.getLogger(__name__)
_LATEST = 2**64 - 1  #: [ns]
#: The log's column for each field that is read, by topic.
TOPICS = {topic: columns for topic in LOG_TYPES if (columns := columns_of(topic))}


def newest(root: Path | str = 'bags') -> Path:
    """Return the bag in the folder `root` that changed last; UserError: there is none."""
    files = [file for file in Path(root).glob('*/*.mcap') if not file.is_symlink()]
    if not files:
        raise UserError(
            f'there is no bag in {str(Path(root).absolute())!r}: make a run first, name a bag, '
            'or change to the folder that holds your bags/'
        )
    return max(files, key=lambda file: (file.lstat().st_mtime_ns, file)).parent


def info(path: Path | str) -> dict[str, str]:
    """Return the metadata of the run: command line, versions, parameters and the like."""
    return load(path, messages=False).info


def read(path: Path | str, namespace: str | None = None) -> Log:
    """Return the log of a run, read from its bag.

    A bag whose run was killed is read up to its last whole record, with a warning in the log.

    Parameters
    ----------
    path
        A bag's directory, or an MCAP file.
    namespace
        The car's namespace, such as `/car1`; needed only for a bag with several cars.

    Raises
    ------
    UserError
        There is no bag at `path`, or it has no such car, or it has several cars.

    Examples
    --------
    >>> from barc_sim import read_bag
    >>> log = read_bag(max(Path('bags').iterdir()))
    >>> len(log)
    1152
    """
    return load(path).log(namespace)


@dataclass
class Bag:
    """A run as a bag has it: metadata, attached files, and the messages that a log is made of."""

    path: Path
    info: dict[str, str] = field(default_factory=dict)  #: the run's metadata
    attachments: dict[str, bytes] = field(default_factory=dict)  #: by name
    #: The messages, by namespace and topic.
    samples: defaultdict[str, dict[str, Samples]] = field(default_factory=lambda: defaultdict(dict))
    parameters: ParameterHistory = field(default_factory=ParameterHistory)  #: of all nodes

    @property
    def cars(self) -> list[str]:
        """The namespaces of the cars, those with states; /car10 comes after /car2."""
        cars = sorted(self.samples, key=lambda car: (len(car), car))
        return [car for car in cars if len(self.samples[car].get(STATE, ()))]

    def log(self, namespace: str | None = None) -> Log:
        """Return the run of a car, as `read` does."""
        name, wanted = str(self.path), namespace and '/' + namespace.strip('/')
        cars = [car for car in self.cars if wanted in (None, car)]
        if not cars:
            whose = 'of a car' if wanted is None else f'of the car {wanted}'
            raise UserError(
                f'{name!r} has no states {whose} (topic {STATE} of type {LOG_TYPES[STATE]}): '
                'name the bag of a run'
            )
        if len(cars) > 1:
            raise UserError(
                f'{name!r} has several cars, {", ".join(cars)}: name one, as in '
                f'--namespace {cars[0]}'
            )
        samples = {topic: each for topic, each in self.samples[cars[0]].items() if len(each)}
        log = join(samples)
        _check_log(self.path, log)
        log = replace(log, parameters=self._parameters(cars[0], samples))
        return replace(log, track=self._track()) if isinstance(log, TrackLog) else log

    def _parameters(self, car: str, samples: Mapping[str, Samples]) -> dict[str, Floats]:
        """Return the parameters of a log: their values when each state's command was computed."""
        times = decided(samples)
        columns = {}
        for node, at in ((CONTROLLER, times.answered), (SIMULATOR, times.stepped)):
            found = self.parameters.columns(f'{car.rstrip("/")}/{node}', at)
            for name, values in found.items():
                if node == CONTROLLER or name in LIVE:
                    columns[f'{node}.{name}'] = values
        return columns

    def _track(self) -> Track | None:
        """Return the track that the run has attached; None if it has none or an invalid one."""
        data = self.attachments.get(TRACK_NAME, b'')
        with suppress(ValueError, TypeError, RecursionError, UserError):
            if len(data) <= bounds.MAX_TRACK:
                lengths, curvatures, width, name, start = json.loads(data)
                track = Track(lengths, curvatures, width, str(name), Pose(*start))
                if all(abs(each) <= bounds.MAX_DISTANCE for each in (track.length, *track.start)):
                    return track
        return None


def load(path: Path | str, *, messages: bool = True) -> Bag:
    """Read a bag; without `messages`, read only its metadata and its attached files."""
    contents = Contents(Path(path), timed=True)
    bag = Bag(contents.path, contents.metadata, contents.attachments)
    if not messages:
        return bag
    bag.parameters = ParameterHistory(contents.metadata.get('parameters', ''))
    decoders: dict[tuple[str, ...], _Decoder | None] = {}  # by topic, encoding and definition
    sinks: dict[str, tuple[Topic, Callable[[Message], None] | None]] = {}  # by topic
    undecodable = 0
    for message in contents.messages():
        topic = message.topic
        if (sink := sinks.get(topic.name)) is None or sink[0] is not topic:
            sink = sinks[topic.name] = (topic, _sink(bag, topic, decoders))
        take = sink[1]
        if take is None:
            continue
        try:
            take(message)
        except Exception:  # noqa: BLE001 (damage may raise anything)
            undecodable += 1
    for file in contents.files:
        if file.damage:
            _logger.warning('%s is unfinished or damaged: read its whole records', file.path)
    if undecodable:
        _logger.warning('%s has %d messages that cannot be decoded: left out', path, undecodable)
    return bag


def _sink(
    bag: Bag, topic: Topic, decoders: dict[tuple[str, ...], _Decoder | None]
) -> Callable[[Message], None] | None:
    """Return what takes a topic's messages into the bag; None if they are not read."""
    namespace, _, name = topic.name.rpartition('/')
    is_event = (topic.name, topic.type) == (PARAMETER_EVENTS, EVENT_TYPE)
    if not is_event and topic.type != LOG_TYPES.get(name):
        return None
    key = name, topic.message_encoding, topic.definition
    if key not in decoders and len(decoders) < bounds.MAX_SCHEMAS:
        decoders[key] = None
        with suppress(Exception):  # damage may raise anything
            decoders[key] = _Decoder(topic) if is_event else _StateDecoder(name, topic)
    decoder = decoders.get(key)
    if isinstance(decoder, _StateDecoder):
        # The states of a PID and of other controllers fill the same columns.
        name = PID_STATE if name == CONTROLLER_STATE else name
        samples = bag.samples[namespace or '/'].setdefault(name, Samples(len(TOPICS[name])))
        return partial(_add_sample, samples, decoder)
    return partial(_add_event, bag.parameters, decoder) if decoder else _refuse


def _refuse(message: Message) -> None:
    raise ValueError(message.topic.definition)


def _add_event(parameters: ParameterHistory, decoder: _Decoder, message: Message) -> None:
    parameters.add(decoder.decode(message.data), message.published)


def _add_sample(samples: Samples, decoder: _StateDecoder, message: Message) -> None:
    stamp, values, terms = decoder.decode_state(message.data)
    samples.add(stamp, message.published, values, terms)


class _Decoder:
    """Decodes the messages of a topic by the bag's definition, which must agree with barc_sim's."""

    def __init__(self, topic: Topic) -> None:
        types = types_of(topic)
        for kind, (_, described) in types.items():
            ours = dict(store().fielddefs.get(kind, ((), ()))[1])
            if any(of != ours.get(field, of) for field, of in described):
                raise ValueError(kind)
        self._type = topic.type
        self._store = get_typestore(Stores.EMPTY)
        self._store.register(types)

    def decode(self, data: bytes) -> Any:  # noqa: ANN401 (of the topic's type)
        """Return a message."""
        if len(data) > bounds.MAX_MESSAGE:
            raise ValueError('message')
        return self._store.deserialize_cdr(data, self._type)


class _StateDecoder(_Decoder):
    """Decodes the messages that a log is made of."""

    def __init__(self, name: str, topic: Topic) -> None:
        super().__init__(topic)
        #: The prefix in the log of terms that a message names; None: it names none.
        self._prefix = {CONTROLLER_STATE: '', LANE_STATE: LANE}.get(name)
        self._fields = [*TOPICS[PID_STATE if name == CONTROLLER_STATE else name]]

    def decode_state(self, data: bytes) -> tuple[int, Iterable[float], Mapping[str, float]]:
        """Return a message's stamp [ns], the values of its fields, and the terms that it names."""
        decoded = self.decode(data)
        terms: dict[str, float] = {}
        if self._prefix is not None:
            pairs = zip(decoded.names, decoded.values.tolist(), strict=True)
            named = {self._prefix + name: value for name, value in pairs}
            terms = {name: named[name] for name in recordable(named)}
        # A bag of an earlier version may lack a field.
        values = [
            terms.pop(field) if field in terms else getattr(decoded, field, np.nan)
            for field in self._fields
        ]
        return to_nanoseconds(decoded.header.stamp), values, terms


class Samples:
    """The messages of a topic, in the order of the bag; a message's place is its index in it."""

    def __init__(self, width: int) -> None:
        """Begin without messages; each will have `width` fields."""
        self._pack = Struct(f'<qQ{width}d').pack
        self._packed = bytearray()
        self._type = np.dtype([('stamp', '<i8'), ('published', '<u8'), ('values', '<f8', width)])
        #: The places of the messages that have a term, and its values there, by the term's name.
        self._terms: dict[str, tuple[array[int], array[float]]] = {}

    def add(
        self, stamp: int, published: int, values: Iterable[float], terms: Mapping[str, float]
    ) -> None:
        """Add a message with its stamp and the time of its publication [ns].

        An exception: a value is no number, or there are too many terms.
        """
        place, packed = len(self), self._pack(stamp, published, *values)
        if len(self._terms) + len(terms.keys() - self._terms) > bounds.MAX_TERMS:
            raise ValueError('terms')
        self._packed += packed
        for name, value in terms.items():
            places, of_term = self._terms.setdefault(name, (array('q'), array('d')))
            places.append(place)
            of_term.append(value)

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self._packed) // self._type.itemsize

    @property
    def rows(self) -> NDArray[np.void]:
        """The messages as records of `stamp` and `published` [ns] and `values`, shape `(n,)`."""
        return np.frombuffer(self._packed, self._type)

    def first(self) -> NDArray[np.intp]:
        """Return the place of the first published message of each stamp."""
        rows = self.rows
        order = np.lexsort((-np.arange(len(rows)), rows['published'], rows['stamp']))
        _, at = np.unique(rows['stamp'][order], return_index=True)
        return order[at]

    def at(self, stamps: NDArray[np.int64]) -> NDArray[np.intp]:
        """Return the place of the first message with each of `stamps`; -1 without a message."""
        first = self.first()
        present = self.rows['stamp'][first]
        at = np.minimum(np.searchsorted(present, stamps), len(present) - 1)
        return np.where(present[at] == stamps, first[at], -1) if len(present) else at

    def values(self, places: NDArray[np.intp]) -> Floats:
        """Return the fields of the messages at `places`, shape `(fields, n)`; NaN at -1."""
        values = self.rows['values']
        columns: Floats = np.vstack([values, np.full(values.shape[1], np.nan)])[places].T
        return columns

    def terms(self, places: NDArray[np.intp]) -> dict[str, Floats]:
        """Return the terms of the messages at `places`; NaN where a message has no such term."""
        columns = {}
        for name, (with_term, values) in self._terms.items():
            column = np.full(len(self) + 1, np.nan)
            column[np.array(with_term)] = values
            if np.isin(places, with_term).any():
                columns[name] = column[places]
        return columns


def join(samples: Mapping[str, Samples]) -> Log:
    """Return the log of a car from its samples, by topic; there must be at least one state.

    Topics are joined on the stamp of the state that each message belongs to. The simulator's record
    of the command that acts comes before the answer that a controller published; a state without
    a record had no deadline. In a bag without records, `_missed` decides by times of publication.
    """
    states = samples[STATE].rows[samples[STATE].first()]
    stamps, published = states['stamp'], states['published']
    places = {topic: each.at(stamps) for topic, each in samples.items()}
    missed = np.ones(len(stamps), np.bool_)
    if commands := samples.get(ECU):
        missed = _missed(commands.rows, places[ECU], published)
    columns: dict[str, Any] = {'t': (stamps - stamps[0]) / 1e9}
    for topic, fields in TOPICS.items():
        if topic not in samples:
            rows = np.full((len(fields), len(stamps)), np.nan)
        else:
            rows = samples[topic].values(places[topic])
        for name, row in zip(fields.values(), rows, strict=True):
            columns[name] = np.where(np.isnan(row), columns.get(name, np.nan), row)
    if APPLIED_COMMAND not in samples:
        columns['missed'] = missed
    kind = TrackLog if np.isfinite(columns['s']).any() else Log
    terms: dict[str, Floats] = {}
    for topic in samples:
        terms |= samples[topic].terms(places[topic])
    return log_of_columns(kind, terms | {name: columns[name] for name in kind.declared})


class Decided(NamedTuple):
    """When the command for each state was decided [ns], shape `(n,)`, by times of publication."""

    answered: NDArray[np.uint64]  #: by the controller; without an answer, as `stepped`
    stepped: NDArray[np.uint64]  #: by the simulator, which then takes the step


def decided(samples: Mapping[str, Samples]) -> Decided:
    """Return when the command for each state of a log was decided."""
    states = samples[STATE].rows[samples[STATE].first()]
    # At the latest the next state was published; nothing follows the last one.
    times = np.append(states['published'][1:], np.uint64(_LATEST))
    columns = []
    for topic in (APPLIED_COMMAND, ECU):
        if topic in samples:
            at = samples[topic].at(states['stamp'])
            published = np.append(samples[topic].rows['published'], np.uint64(0))[at]
            times = np.where(at < 0, times, np.minimum(published, times))
        columns.append(times)
    stepped, answered = columns
    return Decided(answered, stepped)


@np.errstate(invalid='ignore')  # of infinite places
def _check_log(path: Path, log: Log) -> None:
    """Refuse stamps, places or grades that no run has."""
    gaps = np.diff(log.t, prepend=0.0)
    k = int(np.argmax(gaps))
    if gaps[k] > bounds.MAX_GAP or log.t[-1] > bounds.MAX_DURATION:
        excess = f'states of {log.t[-1]:.6g} s, with {gaps[k]:.6g} s between two of them'
        bounds.refuse(path, excess, f'{bounds.MAX_DURATION:g} s and {bounds.MAX_GAP:g} s')
    far = float(np.fmax.reduce(np.abs([log.distance, log.y]), axis=None, initial=0.0))
    if far > bounds.MAX_DISTANCE:
        bounds.refuse(path, f'a state {far:.6g} m from the start', f'{bounds.MAX_DISTANCE:g} m')
    steepest = float(np.fmax.reduce(np.abs(log.theta_deg), initial=0.0))
    if steepest >= STEEPEST_DEG:
        bounds.refuse(path, f'a grade of {steepest:.6g} degrees', f'less than {STEEPEST_DEG:g}')


def _missed(
    commands: NDArray[np.void], answers: NDArray[np.intp], published: NDArray[np.uint64]
) -> Flags:
    """Return whether each state's command was missed, shape `(n,)`.

    `answers` has the place of the command that answers each state, or -1. Where another command
    held at the deadline, because the answer is missing or late, its place replaces that.
    """
    order = np.argsort(commands['published'], kind='stable')
    by_deadline = np.searchsorted(commands['published'][order], published[1:], 'left')
    by_deadline = np.append(by_deadline, len(order))
    latest = np.where(by_deadline > 0, order[by_deadline - 1], -1)

    is_late = np.append(commands['published'][answers[:-1]] >= published[1:], False)
    unanswered = (answers < 0) | is_late
    without_stamp = (latest >= 0) & (commands['stamp'][latest] == 0)
    missed: Flags = unanswered & ~without_stamp
    answers[unanswered] = latest[unanswered]
    return missed
