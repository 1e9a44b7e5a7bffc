"""Reads the bag of a run: from its directory to a `Bag`, and from that to a `Log`."""

from __future__ import annotations

import json
import logging
from collections import defaultdict
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from barc_sim.bags import bounds
from barc_sim.bags.bag_files import suffix_of
from barc_sim.bags.contents import Contents
from barc_sim.bags.decoders import Decoder, LogDecoder
from barc_sim.bags.metadata import TRACK_NAME
from barc_sim.bags.parameters import EVENT_TYPE, ParameterHistory
from barc_sim.bags.samples import TOPICS, Samples, decision_times, join
from barc_sim.errors import UserError
from barc_sim.interfaces.nodes import CONTROLLER, SIMULATOR
from barc_sim.interfaces.topics import LOG_TYPES, PARAMETER_EVENTS, STATE
from barc_sim.simulation.log import TrackLog
from barc_sim.vehicle.parameters import LIVE
from barc_sim.vehicle.road import STEEPEST_DEG
from barc_sim.vehicle.track import Pose, Track

if TYPE_CHECKING:
    from collections.abc import Mapping

    from barc_sim.bags.messages import BagMessage, Topic
    from barc_sim.simulation.log import Floats, Log

_logger = logging.getLogger(__name__)


def newest(root: Path | str = 'bags') -> Path:
    """Return the bag that changed last.

    Parameters
    ----------
    root
        The folder with the bags.

    Raises
    ------
    UserError
        There is none.
    """
    files = [file for file in Path(root).glob('*/*') if suffix_of(file) and not file.is_symlink()]
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
        A bag's directory, or a file of it.
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
    #: The messages by the namespace of a car, such as `/car1`, and then by the name of a topic.
    samples: defaultdict[str, dict[str, Samples]] = field(default_factory=lambda: defaultdict(dict))
    parameters: ParameterHistory = field(default_factory=ParameterHistory)  #: of all nodes

    @property
    def cars(self) -> list[str]:
        """The namespaces of the cars, those with states; /car10 comes after /car2."""
        cars = sorted(self.samples, key=lambda car: (len(car), car))
        return [car for car in cars if len(self.samples[car].get(STATE, ()))]

    def log(self, namespace: str | None = None) -> Log:
        """Return the run of a car, as `read` does."""
        car = self._car(namespace)
        samples = {
            topic: of_topic for topic, of_topic in self.samples[car].items() if len(of_topic)
        }
        log = join(samples)
        _check_log(self.path, log)

        log = replace(log, parameters=self._parameters(car, samples))
        if isinstance(log, TrackLog):
            log = replace(log, track=self._track())
        return log

    def _car(self, namespace: str | None) -> str:
        """Return the namespace of the car that is asked for: by default, of the only one."""
        cars = self.cars
        whose = 'of a car'
        if namespace is not None:
            name = '/' + namespace.strip('/')
            cars = [car for car in cars if car == name]
            whose = f'of the car {name}'

        if not cars:
            raise UserError(
                f'{str(self.path)!r} has no states {whose} (topic {STATE} of type '
                f'{LOG_TYPES[STATE]}): name the bag of a run'
            )
        if len(cars) > 1:
            raise UserError(
                f'{str(self.path)!r} has several cars, {", ".join(cars)}: name one, as in '
                f'--namespace {cars[0]}'
            )
        return cars[0]

    def _parameters(self, car: str, samples: Mapping[str, Samples]) -> dict[str, Floats]:
        """Return the parameters of a log: their values when each state's command was computed."""
        prefix = car.rstrip('/')
        times = decision_times(samples)
        controller = self.parameters.columns(f'{prefix}/{CONTROLLER}', times.answered)
        simulator = self.parameters.columns(f'{prefix}/{SIMULATOR}', times.stepped)

        columns = {f'{CONTROLLER}.{name}': values for name, values in controller.items()}
        for name, values in simulator.items():
            if name in LIVE:
                columns[f'{SIMULATOR}.{name}'] = values
        return columns

    def _track(self) -> Track | None:
        """Return the track that the run has attached; None if it has none or an invalid one."""
        data = self.attachments.get(TRACK_NAME, b'')
        if len(data) > bounds.MAX_TRACK:
            return None

        with suppress(ValueError, TypeError, RecursionError, UserError):
            lengths, curvatures, width, name, start = json.loads(data)
            track = Track(lengths, curvatures, width, str(name), Pose(*start))
            distances = (track.length, *track.start)
            if all(abs(distance) <= bounds.MAX_DISTANCE for distance in distances):
                return track
        return None


@np.errstate(invalid='ignore')  # of infinite places
def _check_log(path: Path, log: Log) -> None:
    """Refuse stamps, places or grades that no run has."""
    gaps = np.diff(log.t, prepend=0.0)
    max_gap = float(gaps.max())
    if max_gap > bounds.MAX_GAP or log.t[-1] > bounds.MAX_DURATION:
        excess = f'states of {log.t[-1]:.6g} s, with {max_gap:.6g} s between two of them'
        bounds.refuse(path, excess, f'{bounds.MAX_DURATION:g} s and {bounds.MAX_GAP:g} s')

    farthest = float(np.fmax.reduce(np.abs([log.distance, log.y]), axis=None, initial=0.0))
    if farthest > bounds.MAX_DISTANCE:
        excess = f'a state {farthest:.6g} m from the start'
        bounds.refuse(path, excess, f'{bounds.MAX_DISTANCE:g} m')

    steepest = float(np.fmax.reduce(np.abs(log.theta_deg), initial=0.0))
    if steepest >= STEEPEST_DEG:
        bounds.refuse(path, f'a grade of {steepest:.6g} degrees', f'less than {STEEPEST_DEG:g}')


def load(path: Path | str, *, messages: bool = True) -> Bag:
    """Read a bag.

    Damaged parts are left out, with a warning in the program's log.

    Parameters
    ----------
    path
        A bag's directory, or a file of it.
    messages
        Whether to read more than its metadata and its attached files.

    Raises
    ------
    UserError
        There is no bag at `path`, it cannot be read, or it exceeds a bound.
    """
    contents = Contents(Path(path), timed=True)
    bag = Bag(contents.path, contents.metadata, contents.attachments)
    if not messages:
        return bag

    bag.parameters = ParameterHistory(contents.metadata.get('parameters', ''))
    sinks = _Sinks(bag)
    undecodable = 0
    for message in contents.messages():
        sink = sinks.sink_of(message.topic)
        if sink is None:
            continue
        try:
            sink.add(message)
        except Exception:  # noqa: BLE001 (damage may raise anything)
            undecodable += 1

    for file in contents.files:
        if file.damage:
            _logger.warning('%s is unfinished or damaged: read its whole records', file.path)
    if undecodable:
        _logger.warning('%s has %d messages that cannot be decoded: left out', path, undecodable)
    return bag


class _Sink(Protocol):
    """Adds the messages of a topic to a bag."""

    def add(self, message: BagMessage) -> None:
        """Add a message; an exception: it cannot be decoded."""


class _Sinks:
    """Makes the sinks of a bag's topics, one for each topic."""

    def __init__(self, bag: Bag) -> None:
        self._bag = bag
        self._sinks: dict[int, _Sink | None] = {}  # by identity of the topic
        self._decoders: dict[tuple[str, ...], Decoder | LogDecoder | None] = {}

    def sink_of(self, topic: Topic) -> _Sink | None:
        """Return the sink of a topic; None if its messages are not read."""
        identity = id(topic)
        if identity not in self._sinks:
            self._sinks[identity] = self._make(topic)
        return self._sinks[identity]

    def _make(self, topic: Topic) -> _Sink | None:
        namespace, _, name = topic.name.rpartition('/')
        is_event = topic.name == PARAMETER_EVENTS and topic.type == EVENT_TYPE
        if not is_event and topic.type != LOG_TYPES.get(name):
            return None

        decoder = self._decoder_of(topic, name, is_event=is_event)
        if decoder is None:
            # It refuses each message, so that `load` counts it as undecodable.
            return _UndecodableSink()
        if isinstance(decoder, Decoder):
            return _ParameterSink(self._bag.parameters, decoder)

        car = self._bag.samples[namespace or '/']
        if decoder.topic not in car:
            car[decoder.topic] = Samples(len(TOPICS[decoder.topic]))
        return _LogSink(car[decoder.topic], decoder)

    def _decoder_of(
        self, topic: Topic, name: str, *, is_event: bool
    ) -> Decoder | LogDecoder | None:
        """Return the decoder of equal topics; None: their definition cannot be read."""
        key = (name, topic.message_encoding, topic.definition)
        if key not in self._decoders and len(self._decoders) < bounds.MAX_SCHEMAS:
            self._decoders[key] = None
            with suppress(Exception):  # damage may raise anything
                self._decoders[key] = Decoder(topic) if is_event else LogDecoder(name, topic)
        return self._decoders.get(key)


class _LogSink:
    """Adds the messages of a log topic, such as `ecu`, to the samples of a car."""

    def __init__(self, samples: Samples, decoder: LogDecoder) -> None:
        self._samples = samples
        self._decoder = decoder

    def add(self, message: BagMessage) -> None:
        sample = self._decoder.decode(message.data)
        self._samples.add(sample.stamp, message.published, sample.values, sample.terms)


class _ParameterSink:
    """Adds changes of parameters to their history."""

    def __init__(self, parameters: ParameterHistory, decoder: Decoder) -> None:
        self._parameters = parameters
        self._decoder = decoder

    def add(self, message: BagMessage) -> None:
        self._parameters.add(self._decoder.decode(message.data), message.published)


class _UndecodableSink:
    """Refuses all messages, so that they are counted."""

    def add(self, message: BagMessage) -> None:
        raise ValueError(message.topic.definition)
