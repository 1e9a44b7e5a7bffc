"""The bags of a playback, read as one."""

from __future__ import annotations

from collections import deque
from concurrent.futures import ThreadPoolExecutor
from heapq import merge
from itertools import count, islice
from operator import attrgetter
from typing import TYPE_CHECKING

from barc_sim.bags.contents import Contents
from barc_sim.bags.metadata import Span
from barc_sim.nodes.latched_messages import LatchedMessages

if TYPE_CHECKING:
    from collections.abc import Container, Iterator, Sequence
    from pathlib import Path

    from barc_sim.bags.messages import BagMessage, Topic

_BATCH = 20  #: messages read at a time
_BATCHES = 16  #: batches read ahead


class PlaybackBags:
    """The bags of a playback: their topics, and their messages in order of reception.

    Parameters
    ----------
    paths
        The bags.

    Attributes
    ----------
    name
        The bags' paths, for messages to the user.
    span
        The time span of all messages.

    Raises
    ------
    UserError
        There is no bag, or it cannot be read.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self.name = ' with '.join(repr(str(path)) for path in paths)
        self._bags = [Contents(path) for path in paths]
        self.span = Span()
        for bag in self._bags:
            bag.complete()
            self.span += bag.span

    @property
    def topic_names(self) -> list[str]:
        """The topics' names, each once."""
        return list(dict.fromkeys(name for bag in self._bags for name in bag.names))

    def records(self, name: str) -> list[list[Topic]]:
        """Return the records of a topic, those of one type and encoding together."""
        groups: dict[tuple[str, str], list[Topic]] = {}
        for bag in self._bags:
            for topic in bag.topics:
                if topic.name == name:
                    kind = (topic.type, topic.message_encoding)
                    groups.setdefault(kind, []).append(topic)
        return list(groups.values())

    def messages(
        self, start: int, end: int | None, topics: Container[int], *, with_latched: bool
    ) -> Iterator[BagMessage]:
        """Yield messages in order of reception; of equal times, those of an earlier bag first.

        A thread reads ahead, so that a large message does not delay the others.

        Parameters
        ----------
        start, end
            The time span [ns]; no `end`: to the last message.
        topics
            The identities of the topics' records.
        with_latched
            Whether to begin with the earlier messages that latched topics hold at the start.
        """
        messages = merge(*[bag.in_order() for bag in self._bags], key=attrgetter('received'))
        latched = LatchedMessages(start) if with_latched else None
        return _ahead(_between(messages, start, end, topics, latched))


def _between(
    messages: Iterator[BagMessage],
    start: int,
    end: int | None,
    topics: Container[int],
    latched: LatchedMessages | None,
) -> Iterator[BagMessage]:
    """Yield the messages of some topics between two times, after the `latched` ones."""
    for message in messages:
        if id(message.topic) not in topics:
            continue
        if end is not None and message.received > end:
            break
        if message.received >= start:
            if latched:
                yield from latched.held()
                latched = None
            yield message
        elif latched:
            latched.add(message)
    if latched:
        yield from latched.held()


def _ahead(messages: Iterator[BagMessage]) -> Iterator[BagMessage]:
    """Yield the messages, which a thread reads ahead."""
    pool = ThreadPoolExecutor(1)
    try:
        batches = (pool.submit(list, islice(messages, _BATCH)) for _ in count())
        ahead = deque(islice(batches, _BATCHES))
        batch = ahead.popleft().result()
        while batch:
            ahead.append(next(batches))
            yield from batch
            batch = ahead.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)
