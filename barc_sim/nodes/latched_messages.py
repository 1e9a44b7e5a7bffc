"""The messages of latched topics from before a playback's start."""

from __future__ import annotations

from collections import deque
from operator import attrgetter
from typing import TYPE_CHECKING

from barc_sim.ros.topics import latch

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from barc_sim.bags.messages import BagMessage, Topic

#: [B] of a latched topic's earlier messages: DDS does not announce how many a publisher holds.
_MAX_SIZE = 1 << 20


class LatchedMessages:
    """Holds the last messages of latched topics before a time, as their publishers did then.

    Parameters
    ----------
    start
        The bag's time [ns] at which a subscription would receive them at once.
    topics
        The topics, latched ones and others.
    """

    def __init__(self, start: int, topics: Iterable[Topic]) -> None:
        self._start = start
        self._queues: dict[int, _Queue] = {}  # by the identity of the topic
        for topic in topics:
            queue = _new_queue(start, topic)
            if queue:
                self._queues[id(topic)] = queue

    def wants(self, topics: Collection[int], last: int) -> bool:
        """Return whether earlier messages of some topics can be held.

        Parameters
        ----------
        topics
            The identities of the topics.
        last
            The time of the last of the messages [ns].
        """
        return any(
            not queue.is_full and last >= queue.since
            for identity, queue in self._queues.items()
            if identity in topics
        )

    def add_earlier(self, messages: Iterable[BagMessage]) -> None:
        """Add a block of messages in their order, all of them before those added until now."""
        blocks = {identity: queue.new() for identity, queue in self._queues.items()}
        for message in messages:
            block = blocks.get(id(message.topic))
            if block is not None and block.since <= message.received < self._start:
                block.add(message)
        for identity, block in blocks.items():
            self._queues[identity].add_earlier(block)

    def held(self) -> list[BagMessage]:
        """Return the messages, in order of reception."""
        messages = [message for queue in self._queues.values() for message in queue.messages]
        return sorted(messages, key=attrgetter('received'))


class _Queue:
    """The queues of all publishers of a topic as one: a bag does not have the publishers."""

    def __init__(self, depth: int, since: float, publishers: int) -> None:
        """Hold at most `depth` messages, all received `since` a time [ns].

        Large messages are held only once for each publisher.
        """
        self.since = since
        self.messages: deque[BagMessage] = deque()
        self._has_refused = False  # whether there was no room for an earlier message
        self._depth = depth
        self._publishers = publishers
        self._size = 0  # [B]

    @property
    def is_full(self) -> bool:
        """Whether there is no room for earlier messages."""
        return self._has_refused or len(self.messages) == self._depth

    def new(self) -> _Queue:
        """Return an empty queue of the same kind."""
        return _Queue(self._depth, self.since, self._publishers)

    def add(self, message: BagMessage) -> None:
        """Add a message, in place of the oldest ones."""
        self.messages.append(message)
        self._size += len(message.data)
        while self._has_excess():
            self._size -= len(self.messages.popleft().data)

    def add_earlier(self, block: _Queue) -> None:
        """Add as many of earlier messages as there is room for."""
        for message in reversed(block.messages):
            self.messages.appendleft(message)
            self._size += len(message.data)
            if self._has_excess():
                self.messages.popleft()
                self._size -= len(message.data)
                self._has_refused = True
                return

    def _has_excess(self) -> bool:
        count = len(self.messages)
        return count > self._depth or (self._size > _MAX_SIZE and count > self._publishers)


def _new_queue(start: int, topic: Topic) -> _Queue | None:
    """Return the queue of a latched topic; None: the topic is not latched."""
    latched = latch(topic.offered_qos)
    if latched is None:
        return None
    since = start - latched.lifespan
    return _Queue(latched.depth, since, publishers=len(topic.offered_qos))
