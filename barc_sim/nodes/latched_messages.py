"""The messages of latched topics from before a playback's start."""

from __future__ import annotations

from collections import deque
from operator import attrgetter
from typing import TYPE_CHECKING

from barc_sim.ros.topics import latch

if TYPE_CHECKING:
    from barc_sim.bags.messages import BagMessage, Topic

#: [B] of a latched topic's earlier messages: DDS does not announce how many a publisher holds.
_MAX_SIZE = 1 << 20


class LatchedMessages:
    """Holds the last messages of latched topics before a time, as their publishers did then."""

    def __init__(self, start: int) -> None:
        """Hold what a subscription of the bag's time `start` [ns] would receive at once."""
        self._start = start
        self._queues: dict[int, _Queue | None] = {}  # by the identity of the topic

    def add(self, message: BagMessage) -> None:
        """Add a message received before the start; the messages come in order."""
        identity = id(message.topic)
        if identity not in self._queues:
            self._queues[identity] = _new_queue(message.topic)
        queue = self._queues[identity]
        if queue:
            queue.add(message)

    def held(self) -> list[BagMessage]:
        """Return the messages, in order of reception."""
        messages: list[BagMessage] = []
        for queue in self._queues.values():
            if queue:
                earliest = self._start - queue.lifespan
                messages += [each for each in queue.messages if each.received >= earliest]
        return sorted(messages, key=attrgetter('received'))


class _Queue:
    """The queues of all publishers of a topic as one: a bag does not have the publishers."""

    def __init__(self, depth: int, lifespan: float, publishers: int) -> None:
        """Hold at most `depth` messages for `lifespan` [ns]."""
        self.lifespan = lifespan
        self.messages: deque[BagMessage] = deque(maxlen=depth)
        self._publishers = publishers
        self._size = 0  # [B]

    def add(self, message: BagMessage) -> None:
        """Add a message; large messages are held only once for each publisher."""
        if len(self.messages) == self.messages.maxlen:
            self._remove_oldest()
        self.messages.append(message)
        self._size += len(message.data)
        while self._size > _MAX_SIZE and len(self.messages) > self._publishers:
            self._remove_oldest()

    def _remove_oldest(self) -> None:
        self._size -= len(self.messages.popleft().data)


def _new_queue(topic: Topic) -> _Queue | None:
    """Return the queue of a latched topic; None: the topic is not latched."""
    latched = latch(topic.offered_qos)
    if latched is None:
        return None
    return _Queue(latched.depth, latched.lifespan, publishers=len(topic.offered_qos))
