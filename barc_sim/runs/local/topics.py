"""The topics of a run without ROS: what is published is serialized for the recorder."""

from __future__ import annotations

import time
from collections import deque
from typing import TYPE_CHECKING, Any

from barc_sim.bags.messages import Message, packer, topic

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from barc_sim.bags.recording import Recording


class Publisher:
    """Publishes the messages of one topic.

    Attributes
    ----------
    wanted
        Whether anybody receives them: where not, they need not be made.
    number
        Messages published.

    Examples
    --------
    >>> publisher = Publisher('relay', '/ecu', 'barc_interfaces/msg/ECU')
    >>> publisher.wanted
    False
    >>> publisher.subscribe(lambda stamp, fields: print(stamp, fields['motor']))
    >>> publisher.publish(1_020_000_000, {'motor': 2.0, 'servo': 0.0})
    1020000000 2.0
    """

    def __init__(self, node: str, name: str, type_name: str) -> None:
        """Publish on the topic `name`, as the node `node`."""
        self.node, self.name, self.type = node, name, type_name
        self.wanted = False
        self.number = 0
        self._queue: deque[Message] | None = None
        self._subscriptions: list[Callable[[int, Mapping[str, Any]], None]] = []

    def record(self, queue: deque[Message]) -> None:
        """Append the messages to `queue`."""
        self._topic = topic(self.name, self.type)
        self._pack = packer(self.type)
        self._queue = queue
        self.wanted = True

    def subscribe(self, callback: Callable[[int, Mapping[str, Any]], None]) -> None:
        """Call `callback` with stamp [ns] and fields of each message."""
        self._subscriptions.append(callback)
        self.wanted = True

    def publish(self, stamp: int, fields: Mapping[str, Any]) -> None:
        """Publish a message stamped `stamp` [ns]."""
        if self._queue is not None:
            self.number += 1
            now = time.time_ns()
            data = self._pack(stamp, fields)
            self._queue.append(Message(self._topic, data, now, now, self.number))
        for callback in self._subscriptions:
            callback(stamp, fields)


class Topics:
    """All publishers of a run.

    Examples
    --------
    >>> from barc_sim.bags.recording import Recording
    >>> topics = Topics()
    >>> topics.record(Recording())
    >>> publisher = topics.publisher('relay', 'ecu', 'barc_interfaces/msg/ECU')
    >>> publisher.publish(1_020_000_000, {'motor': 2.0, 'servo': 0.0})
    >>> [(message.topic.name, message.number) for message in topics.take()]
    [('/ecu', 1)]
    """

    def __init__(self) -> None:
        """Begin without any."""
        self.publishers: list[Publisher] = []
        self._recording: Recording | None = None
        self._queue: deque[Message] = deque()

    def record(self, recording: Recording) -> None:
        """Keep the messages of the wanted topics from now on for `take`."""
        self._recording = recording
        for publisher in self.publishers:
            self._record(publisher)

    def publisher(self, node: str, name: str, type_name: str) -> Publisher:
        """Return a publisher of `node` on the topic `name`."""
        made = Publisher(node, name if name.startswith('/') else f'/{name}', type_name)
        self.publishers.append(made)
        self._record(made)
        return made

    def _record(self, publisher: Publisher) -> None:
        if self._recording and self._recording.wants(publisher.name):
            publisher.record(self._queue)

    @property
    def waiting(self) -> int:
        """Number of messages that wait for `take`."""
        return len(self._queue)

    def take(self) -> list[Message]:
        """Return the messages to record since the last call, for one thread at a time."""
        taken = []
        while self._queue:
            taken.append(self._queue.popleft())
        return taken
