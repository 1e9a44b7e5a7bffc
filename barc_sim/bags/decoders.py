"""Decodes the messages that a log is made of, by the definitions in the bag."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from rosbags.typesys import Stores, get_typestore

from barc_sim.bags import bounds
from barc_sim.bags.samples import TOPICS
from barc_sim.bags.schemas import types_of
from barc_sim.control.lane import LANE
from barc_sim.interfaces.definitions import store
from barc_sim.interfaces.stamps import to_nanoseconds
from barc_sim.interfaces.topics import CONTROLLER_STATE, LANE_STATE, PID_STATE
from barc_sim.simulation.log import recordable

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from barc_sim.bags.messages import Topic

#: The prefix in the log of terms that a message names, by topic.
_TERM_PREFIXES = {CONTROLLER_STATE: '', LANE_STATE: LANE}


class Decoder:
    """Decodes the messages of a topic.

    Parameters
    ----------
    topic
        The topic with the definition of its type.

    Raises
    ------
    ValueError
        The definition cannot be read, or gives a field another type than barc_sim's definition.
    LookupError
        There is no definition.
    """

    def __init__(self, topic: Topic) -> None:
        types = types_of(topic)
        for name, (_, fields) in types.items():
            _, installed_fields = store().fielddefs.get(name, ((), ()))
            type_of_field = dict(installed_fields)
            for field, type_in_bag in fields:
                if type_in_bag != type_of_field.get(field, type_in_bag):
                    raise ValueError(name)

        self._type = topic.type
        self._store = get_typestore(Stores.EMPTY)
        self._store.register(types)

    def decode(self, data: bytes) -> Any:  # noqa: ANN401 (of the topic's type)
        """Return a message; an exception: `data` is damaged."""
        if len(data) > bounds.MAX_MESSAGE:
            raise ValueError('message')
        return self._store.deserialize_cdr(data, self._type)


class LogSample(NamedTuple):
    """What a message contributes to a log."""

    stamp: int  #: [ns] of the state that it belongs to
    values: Sequence[float]  #: of its fields, as in `TOPICS`
    terms: Mapping[str, float]  #: of a controller, by name


class LogDecoder:
    """Decodes the messages of any topic that a log is made of.

    Parameters
    ----------
    name
        The topic's name without namespace.
    topic
        The topic with the definition of its type.

    Raises
    ------
    ValueError, LookupError
        As of `Decoder`.
    """

    def __init__(self, name: str, topic: Topic) -> None:
        self._decoder = Decoder(topic)
        self._prefix = _TERM_PREFIXES.get(name)
        #: The topic whose columns the messages fill: a PID's and other controllers' are the same.
        self.topic = PID_STATE if name == CONTROLLER_STATE else name
        self._fields = list(TOPICS[self.topic])

    def decode(self, data: bytes) -> LogSample:
        """Return the sample of a message; an exception: `data` is damaged."""
        message = self._decoder.decode(data)
        terms = {} if self._prefix is None else self._terms_of(message, self._prefix)
        values = []
        for field in self._fields:
            if field in terms:
                values.append(terms.pop(field))
            else:
                # A bag of an earlier version may lack a field.
                values.append(getattr(message, field, np.nan))
        return LogSample(to_nanoseconds(message.header.stamp), values, terms)

    @staticmethod
    def _terms_of(message: Any, prefix: str) -> dict[str, float]:  # noqa: ANN401
        pairs = zip(message.names, message.values.tolist(), strict=True)
        terms = {prefix + name: value for name, value in pairs}
        return {name: terms[name] for name in recordable(terms)}
