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
        return _ahead(self._played(start, end, topics, with_latched=with_latched))

    def _played(
        self, start: int, end: int | None, topics: Container[int], *, with_latched: bool
    ) -> Iterator[BagMessage]:
        if with_latched:
            yield from self._latched(start, topics)
        bags = [bag.in_order(start) for bag in self._bags]
        for message in merge(*bags, key=attrgetter('received')):
            if end is not None and message.received > end:
                return
            if id(message.topic) in topics:
                yield message

    def _latched(self, start: int, topics: Container[int]) -> list[BagMessage]:
        """Return the messages that latched topics hold at a time."""
        records = [topic for bag in self._bags for topic in bag.topics if id(topic) in topics]
        latched = LatchedMessages(start, records)
        for bag in self._bags:
            for block in bag.blocks_before(start, latched.wants):
                latched.add_earlier(block)
        return latched.held()


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
