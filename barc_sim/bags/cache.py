"""Messages in memory: those that wait for the disk, and those for a snapshot."""

from __future__ import annotations

import threading
from collections import Counter, deque
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from barc_sim.bags.messages import MessageFields

#: [B] of memory that a message takes beside its data.
OVERHEAD = 220


class MessageQueue:
    """A queue of messages up to a size in memory; later messages are lost, and counted.

    It takes all messages of a call or none: they are in memory already. Otherwise a queue that is
    smaller than what comes in a call would lose messages, however fast they are taken out.

    Threads can share it.

    Parameters
    ----------
    max_size
        Size [B] from which on it takes no messages; 0: it takes all.
    """

    def __init__(self, max_size: int) -> None:
        self.max_size = max_size
        self.lost: Counter[str] = Counter()  #: number of lost messages, by topic
        self._size = 0  # [B]
        self._messages: deque[MessageFields] = deque()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self._messages)

    def put(self, messages: Iterable[MessageFields]) -> None:
        """Append messages."""
        with self._lock:
            is_full = self._is_full
            for message in messages:
                if is_full:
                    self._lose(message)
                else:
                    self._append(message)

    @property
    def _is_full(self) -> bool:
        return 0 < self.max_size <= self._size

    def _append(self, message: MessageFields) -> None:
        self._messages.append(message)
        self._size += _size(message)

    def _lose(self, message: MessageFields) -> None:
        topic = message[0]
        self.lost[topic.name] += 1

    def take(self, size: int | None = None) -> list[MessageFields]:
        """Return and remove the earliest messages, until they have a `size` [B]; by default all."""
        taken: list[MessageFields] = []
        with self._lock:
            end = 0 if size is None else self._size - size
            while self._messages and self._size > end:
                taken.append(self._pop())
        return taken

    def _pop(self) -> MessageFields:
        message = self._messages.popleft()
        self._size -= _size(message)
        return message


class MessageRing(MessageQueue):
    """A queue that keeps the latest messages; it loses only a message that is larger than it."""

    @property
    def _is_full(self) -> bool:
        return False

    def _append(self, message: MessageFields) -> None:
        size = _size(message)
        if size > self.max_size:
            self._lose(message)
            return
        self._messages.append(message)
        self._size += size
        while self._size > self.max_size:
            self._pop()


def _size(message: MessageFields) -> int:
    """Return a message's size in memory [B]."""
    _, data, _, _, _ = message
    return OVERHEAD + len(data)
