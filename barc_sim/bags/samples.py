"""Samples of a car's topics -> Log, joined on the stamp of the state that each belongs to."""

from __future__ import annotations

from bisect import bisect_left
from math import inf
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.bags.bounds import MAX_TERMS
from barc_sim.errors import UserError
from barc_sim.simulation.log import COMMAND, MESSAGE_TYPES, PID_STATE, STATE, Log, columns_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray


class Topic(NamedTuple):
    """A topic that a log is made of."""

    type: str
    fields: dict[str, str]  #: the log's column for each field that is taken from the message


#: By name, without namespace.
TOPICS = {
    topic: Topic(kind, columns)
    for topic, kind in MESSAGE_TYPES.items()
    if (columns := columns_of(topic))
}


class Sample(NamedTuple):
    """A message."""

    stamp: int  #: [ns] in its header
    published: int  #: [ns]
    values: tuple[float, ...]  #: in the order of the topic's `fields`
    terms: tuple[tuple[str, float], ...] = ()  #: those that the message names by itself


def join(samples: Mapping[str, Sequence[Sample]]) -> Log:
    """Return the log of a car's samples, by topic; there must be one of `STATE` at least.

    A state's deadline is the publication of the next state. Where several commands answer a
    state, the first counts. Where the latest command by the deadline bears no stamp, it is what
    held, and nothing was missed.
    """
    first = {topic: _first(samples.get(topic, ())) for topic in TOPICS}
    states = [state for _, state in sorted(first[STATE].items())]
    held, missed = _commands(samples.get(COMMAND, ()), states)
    first[COMMAND] |= {k: sample for k, sample in held.items() if k not in first[COMMAND]}

    since_first = np.array([state.stamp - states[0].stamp for state in states])
    columns: dict[str, NDArray[np.float64]] = {'t': since_first / 1e9}
    for topic, (_, fields) in TOPICS.items():
        missing = Sample(0, 0, (np.nan,) * len(fields))
        rows = [first[topic].get(state.stamp, missing).values for state in states]
        columns |= zip(fields.values(), np.array(rows, dtype=np.float64).T, strict=True)
    saturated = columns.pop('saturated') == 1.0
    terms = _terms([first[PID_STATE].get(state.stamp) for state in states])
    return Log(**columns, saturated=saturated, missed=missed, own_terms=terms)


def _terms(samples: Sequence[Sample | None]) -> dict[str, NDArray[np.float64]]:
    """Return the terms that the samples of the states name; NaN where one has none."""
    found = [dict(sample.terms) if sample else {} for sample in samples]
    names = dict.fromkeys(name for terms in found for name in terms)
    if len(names) > MAX_TERMS:
        raise UserError(
            f'the bag has a controller with {len(names)} terms, where at most {MAX_TERMS} are '
            'read: name another bag'
        )
    return {name: np.array([terms.get(name, np.nan) for terms in found]) for name in names}


def _first(samples: Iterable[Sample]) -> dict[int, Sample]:
    """Return the sample that was published first, of each stamp."""
    ordered = sorted(samples, key=lambda sample: sample.published, reverse=True)
    return {sample.stamp: sample for sample in ordered}


def _commands(
    commands: Iterable[Sample], states: Sequence[Sample]
) -> tuple[dict[int, Sample], NDArray[np.bool_]]:
    """Judge whether each state's command was missed.

    Returns
    -------
    held
        By the state's stamp, the command without a stamp that held at its deadline, if one did.
    missed
        Shape `(n,)`.
    """
    commands = sorted(commands, key=lambda command: command.published)
    times = [command.published for command in commands]
    answers = _first(commands)
    deadlines: list[float] = [state.published for state in states[1:]]
    held = {}
    missed = np.zeros(len(states), dtype=np.bool_)
    for k, (state, deadline) in enumerate(zip(states, [*deadlines, inf], strict=True)):
        by_then = bisect_left(times, deadline)
        if by_then and commands[by_then - 1].stamp == 0:
            held[state.stamp] = commands[by_then - 1]
        else:
            answer = answers.get(state.stamp)
            missed[k] = answer is None or answer.published >= deadline
    return held, missed
