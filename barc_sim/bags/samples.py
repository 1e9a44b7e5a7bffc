"""The messages that a log is made of, by topic, and how they become a log."""

from __future__ import annotations

from array import array
from struct import Struct
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.bags import bounds
from barc_sim.interfaces.topics import APPLIED_COMMAND, ECU, LOG_TYPES, STATE
from barc_sim.simulation.log import Flags, Floats, Log, TrackLog, columns_of, log_of_columns

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import NDArray

_LATEST = 2**64 - 1  #: [ns]
#: The log's column for each field that is read, by topic. `controller_state` has no columns of its
#: own: `LogDecoder` adds its messages to those of `pid_state`.
TOPICS = {topic: columns for topic in LOG_TYPES if (columns := columns_of(topic))}
#: The topics in the order in which they fill the log. `ecu` and `applied_command` fill the same
#: columns: the simulator's record of the command comes last, and replaces the answer.
_FILLING_ORDER = (*(topic for topic in TOPICS if topic != APPLIED_COMMAND), APPLIED_COMMAND)


class Samples:
    """The messages of a topic, in the order of the bag; a message's index is its place in it.

    Parameters
    ----------
    width
        Number of fields of each message.
    """

    def __init__(self, width: int) -> None:
        self._pack = Struct(f'<qQ{width}d').pack
        self._packed = bytearray()
        self._type = np.dtype([('stamp', '<i8'), ('published', '<u8'), ('values', '<f8', width)])
        #: The indices of the messages that have a term, and its values there, by the term's name.
        self._terms: dict[str, tuple[array[int], array[float]]] = {}

    def add(
        self, stamp: int, published: int, values: Iterable[float], terms: Mapping[str, float]
    ) -> None:
        """Add a message.

        Parameters
        ----------
        stamp, published
            Its stamp, and the time of its publication [ns].
        values
            Its fields.
        terms
            The terms of a controller that it names.

        Raises
        ------
        struct.error
            A value is not a number, or there are more or fewer than `width`.
        ValueError
            There are too many terms.
        """
        index = len(self)
        packed = self._pack(stamp, published, *values)
        new_terms = terms.keys() - self._terms.keys()
        if len(self._terms) + len(new_terms) > bounds.MAX_TERMS:
            raise ValueError('terms')

        self._packed += packed
        for name, value in terms.items():
            if name not in self._terms:
                self._terms[name] = (array('q'), array('d'))
            indices, values_of_term = self._terms[name]
            indices.append(index)
            values_of_term.append(value)

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self._packed) // self._type.itemsize

    @property
    def rows(self) -> NDArray[np.void]:
        """The messages as records of `stamp` and `published` [ns] and `values`, shape `(n,)`."""
        return np.frombuffer(self._packed, self._type)

    def first(self) -> NDArray[np.intp]:
        """Return the index of the first published message of each stamp, in order of the stamps."""
        rows = self.rows
        # Of two messages that were published at the same time, the later one in the bag counts.
        order = np.lexsort((-np.arange(len(rows)), rows['published'], rows['stamp']))
        _, first_of_stamp = np.unique(rows['stamp'][order], return_index=True)
        return order[first_of_stamp]

    def at(self, stamps: NDArray[np.int64]) -> NDArray[np.intp]:
        """Return the index of the first message with each of `stamps`; -1 without a message."""
        first = self.first()
        if not len(first):
            return np.full(len(stamps), -1)

        present = self.rows['stamp'][first]
        nearest = np.minimum(np.searchsorted(present, stamps), len(present) - 1)
        return np.where(present[nearest] == stamps, first[nearest], -1)

    def values(self, indices: NDArray[np.intp]) -> Floats:
        """Return the fields of the messages at `indices`, shape `(fields, n)`; NaN at -1."""
        values = self.rows['values']
        unknown = np.full(values.shape[1], np.nan)
        columns: Floats = np.vstack([values, unknown])[indices].T
        return columns

    def terms(self, indices: NDArray[np.intp]) -> dict[str, Floats]:
        """Return the terms of the messages at `indices`; NaN where a message has no such term."""
        columns = {}
        for name, (indices_of_term, values) in self._terms.items():
            # The last element is for the index -1.
            column = np.full(len(self) + 1, np.nan)
            column[np.array(indices_of_term)] = values
            if np.isin(indices, indices_of_term).any():
                columns[name] = column[indices]
        return columns


def join(samples: Mapping[str, Samples]) -> Log:
    """Return the log of a car.

    Topics are joined on the stamp of the state that each message belongs to. The commands are those
    that the simulator applied: its record on `applied_command` replaces the answer that a
    controller published on `ecu`. Where there is no record, the times of publication decide which
    command of `ecu` was applied (`_applied_commands`).

    A state without a record, such as the last one of a run that was killed, counts as answered. In
    a bag without any record, the times decide which states were missed, too.

    Parameters
    ----------
    samples
        The messages by topic, with at least one state.
    """
    states = samples[STATE].rows[samples[STATE].first()]
    stamps = states['stamp']
    indices = {topic: of_topic.at(stamps) for topic, of_topic in samples.items()}
    missed = np.ones(len(stamps), np.bool_)
    if ECU in samples:
        applied = _applied_commands(samples[ECU].rows, indices[ECU], states['published'])
        indices[ECU] = applied.indices
        missed = applied.missed

    columns: dict[str, Any] = {'t': (stamps - stamps[0]) / 1e9}
    for topic in _FILLING_ORDER:
        names = TOPICS[topic]
        if topic in samples:
            rows = samples[topic].values(indices[topic])
        else:
            rows = np.full((len(names), len(stamps)), np.nan)
        for name, row in zip(names.values(), rows, strict=True):
            columns[name] = np.where(np.isnan(row), columns.get(name, np.nan), row)
    if APPLIED_COMMAND not in samples:
        columns['missed'] = missed

    terms: dict[str, Floats] = {}
    for topic, of_topic in samples.items():
        terms |= of_topic.terms(indices[topic])

    is_on_track = np.isfinite(columns['s']).any()
    kind = TrackLog if is_on_track else Log
    declared = {name: columns[name] for name in kind.declared}
    return log_of_columns(kind, terms | declared)


class _AppliedCommands(NamedTuple):
    """The command applied from each state on, by times of publication, shape `(n,)`."""

    indices: NDArray[np.intp]  #: of the command; -1 if none was applied
    missed: Flags  #: whether the answer to the state was missing or late


def _applied_commands(
    commands: NDArray[np.void], answers: NDArray[np.intp], published: NDArray[np.uint64]
) -> _AppliedCommands:
    """Return which command was applied from each state on.

    A state's deadline is the publication of the next state. If its answer is missing or late, the
    latest command before the deadline is applied. A command without a stamp answers no state, so
    nothing is missed while it is applied.

    Parameters
    ----------
    commands
        The messages with commands.
    answers
        The index of the command that answers each state; -1 without one, shape `(n,)`.
    published
        The time of publication of each state [ns], shape `(n,)`.
    """
    order = np.argsort(commands['published'], kind='stable')
    count_by_deadline = np.searchsorted(commands['published'][order], published[1:], 'left')
    count_by_deadline = np.append(count_by_deadline, len(order))  # the last state has no deadline
    latest = np.where(count_by_deadline > 0, order[count_by_deadline - 1], -1)

    is_late = np.append(commands['published'][answers[:-1]] >= published[1:], False)
    unanswered = (answers < 0) | is_late
    without_stamp = (latest >= 0) & (commands['stamp'][latest] == 0)
    return _AppliedCommands(
        indices=np.where(unanswered, latest, answers),
        missed=unanswered & ~without_stamp,
    )


class DecisionTimes(NamedTuple):
    """When the command for each state was decided [ns], shape `(n,)`, by times of publication."""

    answered: NDArray[np.uint64]  #: by the controller; without an answer, as `stepped`
    stepped: NDArray[np.uint64]  #: by the simulator, which then takes the step


def decision_times(samples: Mapping[str, Samples]) -> DecisionTimes:
    """Return when the command for each state of a log was decided."""
    states = samples[STATE].rows[samples[STATE].first()]
    # At the latest, the next state was published; no state follows the last one.
    next_published = np.append(states['published'][1:], np.uint64(_LATEST))
    stepped = _earlier(next_published, samples.get(APPLIED_COMMAND), states['stamp'])
    answered = _earlier(stepped, samples.get(ECU), states['stamp'])
    return DecisionTimes(answered, stepped)


def _earlier(
    times: NDArray[np.uint64], samples: Samples | None, stamps: NDArray[np.int64]
) -> NDArray[np.uint64]:
    """Return the publication of the message with each stamp, if it is earlier than in `times`."""
    if samples is None:
        return times
    indices = samples.at(stamps)
    # The last element is for the index -1.
    published: NDArray[np.uint64] = np.append(samples.rows['published'], np.uint64(_LATEST))
    return np.minimum(published[indices], times)
