"""The node `bag_player`: publishes the messages of a bag on their topics."""

from __future__ import annotations

import gc
import os
import sys
import threading
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import count, islice
from operator import attrgetter
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.task import Future
from rosgraph_msgs.msg import Clock as ClockMessage

from barc_sim.bags.bounds import MAX_GAP
from barc_sim.bags.contents import Contents
from barc_sim.bags.messages import CDR
from barc_sim.bags.recording import selected
from barc_sim.errors import UserError, escaped
from barc_sim.ros.node_helpers import to_header
from barc_sim.ros.peers import others_here
from barc_sim.ros.topics import latch, message_class, offer

if TYPE_CHECKING:
    import re
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from rclpy.publisher import Publisher

    from barc_sim.bags.messages import Message, Topic

_SHOW_PERIOD = 0.1  #: [s]
#: [s] without a new subscription after which matching counts as complete; its maximum time.
_MATCHING, _MAX_MATCHING = 1.0, 5.0
_ACK_TIMEOUT = 3.0  #: [s] to wait until the last messages are acknowledged
_SPIN = 2e-4  #: [s] of busy waiting before a message: a sleep ends late
_BATCH, _BATCHES = 20, 16  #: messages read at a time, and how many batches ahead
_MAX_GAP = int(MAX_GAP * 1e9)  #: [ns] between two messages; a longer gap is skipped
#: [B] of a latched topic's earlier messages: DDS does not announce how many a publisher holds.
_MAX_HELD = 1 << 20
_SWITCH = 1e-4  #: [s] after which another thread gives up the interpreter's lock to the player


class Playback(NamedTuple):
    """What to play of a bag, and how."""

    rate: float = 1.0
    loop: bool = False
    start_offset: float = 0.0  #: [s]; earlier messages of latched topics are published first, once
    start_paused: bool = False
    topics: Sequence[re.Pattern[str]] = ()  #: see `selected`
    exclude: Sequence[re.Pattern[str]] = ()
    clock: float | None = None  #: [Hz] of `/clock`; None: only the bag's own, if it has one


def _ahead(messages: Iterator[Message]) -> Iterator[Message]:
    """Yield the messages; a thread reads ahead, so that a large one does not delay the others."""
    with ThreadPoolExecutor(1) as pool:
        batches = (pool.submit(list, islice(messages, _BATCH)) for _ in count())
        ahead = deque(islice(batches, _BATCHES))
        while batch := ahead.popleft().result():
            ahead.append(next(batches))
            yield from batch


class LatchedMessages:
    """Holds the last messages of latched topics before a time, as their publishers did then."""

    def __init__(self, start: int) -> None:
        """Hold what a subscription of the bag's time `start` [ns] would receive at once."""
        self._start = start
        self._queues: dict[int, _Queue | None] = {}  # by the identity of the topic

    def add(self, message: Message) -> None:
        """Add a message received before the start; the messages come in order."""
        identity = id(message.topic)
        if identity not in self._queues:
            queue = None
            if latched := latch(message.topic.offered_qos):
                queue = _Queue(*latched, len(message.topic.offered_qos))
            self._queues[identity] = queue
        if queue := self._queues[identity]:
            queue.add(message)

    def held(self) -> list[Message]:
        """Return the messages, in order of reception."""
        queues = [queue for queue in self._queues.values() if queue]
        held = [
            message
            for queue in queues
            for message in queue.messages
            if message.received >= self._start - queue.lifespan
        ]
        return sorted(held, key=attrgetter('received'))


class _Queue:
    """The queues of all publishers of a topic as one: a bag does not have the publishers."""

    def __init__(self, depth: int, lifespan: float, publishers: int) -> None:
        """Hold at most `depth` messages for `lifespan` [ns]."""
        self.lifespan = lifespan
        self.messages: deque[Message] = deque(maxlen=depth)
        self._publishers = publishers
        self._size = 0

    def add(self, message: Message) -> None:
        """Add a message; large messages are held only once for each publisher."""
        messages = self.messages
        if len(messages) == messages.maxlen:
            self._size -= len(messages.popleft().data)
        messages.append(message)
        self._size += len(message.data)
        while self._size > _MAX_HELD and len(messages) > self._publishers:
            self._size -= len(messages.popleft().data)


class BagPlayer(Node):
    """Publishes a bag's messages as they were sent: serialized, with their QoS and spacing.

    A thread of its own publishes; `finished` is done at the end. A topic whose type is not
    installed is left out, with a warning.

    UserError: there is no bag, or none of its topics can be played.

    Parameters
    ----------
    path
        The MCAP bag, made by any recorder.
    playback
        What to play, and how.
    show
        Called with the line of progress, 10 times a second.
    options
        Options of `rclpy.node.Node`.
    """

    def __init__(
        self,
        path: Path,
        playback: Playback | None = None,
        show: Callable[[str], object] = str,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        self._playback = playback = playback or Playback()
        self._contents = Contents(path)
        self._contents.complete()
        span = self._contents.span  # of the whole bag; `in_order` replaces it
        self._start, self._last = span.start or 0, span.end
        self._first = self._start + int(playback.start_offset * 1e9)
        if self._first > self._last:
            raise UserError(
                f'{str(path)!r} has {span.duration / 1e9:.3f} s of messages: give a shorter '
                '--start-offset'
            )
        super().__init__('bag_player', **options)
        self.failure: str | None = None  #: why not all was played, in a sentence
        self.finished: Future = Future()
        self.played = 0  #: messages
        self._paused, self._steps = playback.start_paused, 0  # messages to publish while paused
        self._keys: SimpleQueue[str] = SimpleQueue()
        self._set_time(self._first)
        names = selected(self._contents.names, playback.topics, playback.exclude)
        if playback.clock and '/clock' in names:
            names.remove('/clock')
        self._topic_publishers: dict[int, Publisher] = {}  # by the identity of the topic
        for name in names:
            self._add_publisher(name)
        if not self._topic_publishers:
            self.destroy_node()
            raise UserError(f'{str(path)!r} has no topic that can be played: give other --topics')
        self._clock_publisher: Publisher | None = None
        self._poll: float | None = None  # [s] of waiting for a key while paused; None: no limit
        self._clock_period = 0  # [ns] of the bag's time
        if playback.clock:
            self._clock_publisher = self.create_publisher(ClockMessage, '/clock', 10)
            self._poll = 1.0 / playback.clock
            self._clock_period = max(1, int(1e9 * playback.rate / playback.clock))
        self._has_begun = False  # whether messages have been played
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_SHOW_PERIOD, lambda: show(self.progress), clock=steady)
        self._thread = threading.Thread(target=self._run, name='player', daemon=True)
        self._thread.start()

    def _add_publisher(self, name: str) -> None:
        """Add the publisher of a topic: of its first type that can be played."""
        played: Topic | None = None
        for topic in self._contents.topics:
            if topic.name != name:
                continue
            try:
                self._topic_publishers[id(topic)] = self._publisher(topic, played)
                played = topic
            except Exception as error:  # noqa: BLE001 (a bag can have any names and types)
                reason = str(error).partition('\n')[0]
                what = f'{name} as {topic.type}' if played else name
                self.get_logger().warning(escaped(f'{what} is not played: {reason}'))

    def _publisher(self, topic: Topic, played: Topic | None) -> Publisher:
        if played:  # DDS accepts one type of a topic in a participant
            raise UserError(f'{played.type} is played')
        if topic.message_encoding != CDR:
            raise UserError(f'its messages are {topic.message_encoding!r}, and not {CDR!r}')
        if not topic.type:
            raise UserError('the bag does not have its type')
        kind = message_class(topic.type)
        qos = offer(topic.offered_qos)
        return self.create_publisher(kind, topic.name, qos)

    @property
    def progress(self) -> str:
        """The line of progress."""
        now = min(max(self._now, self._first), self._last)
        return (
            f'{(now - self._start) / 1e9:7.1f} / {(self._last - self._start) / 1e9:.1f} s  '
            f'{self.played} messages  {"paused" if self._paused else f"x{self._playback.rate:g}"}'
        )

    def on_key(self, key: str) -> None:
        """Handle a key: `space` pauses or resumes, `right` steps, and `quit` ends."""
        self._keys.put(key)

    def _set_time(self, to: int) -> None:
        """Continue from the bag's time `to` [ns]."""
        self._time, self._since = to, time.monotonic_ns()

    @property
    def _now(self) -> int:
        """The time in the bag [ns]."""
        passed = 0 if self._paused else time.monotonic_ns() - self._since
        return self._time + int(passed * self._playback.rate)

    def _wait_until(self, at: int, *, is_message: bool = True) -> bool:
        """Wait until the bag's time `at` [ns] or a step; return False at the key `quit`."""
        while True:
            left = None if self._paused else (at - self._now) / self._playback.rate / 1e9
            key = ''
            try:
                key = self._keys.get(timeout=self._poll if left is None else max(0.0, left - _SPIN))
            except Empty:
                if left is None:  # nodes that begin during a pause need the time, too
                    self._publish_clock(self._now)
            if key == 'quit':
                return False
            if key == 'space':
                self._set_time(self._now)
                self._paused, self._steps = not self._paused, 0
            elif key == 'right':
                self._steps += self._paused
            if self._steps:
                self._steps -= is_message
                self._set_time(max(at, self._time))
                return True
            if not key and left is not None and left <= 0.0:
                return True

    def _run(self) -> None:
        with suppress(OSError):  # without the permission, ordinary threads can delay this one
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
        gc.freeze()  # to collect the present objects, too, would take 20 ms
        interval = sys.getswitchinterval()
        sys.setswitchinterval(_SWITCH)
        try:
            self._wait_for_subscriptions()
            while (ended := self._play()) and self._playback.loop:
                pass
            end = time.monotonic() + _ACK_TIMEOUT
            for publisher in self._topic_publishers.values() if ended else ():
                publisher.wait_for_all_acked(Duration(seconds=max(0.0, end - time.monotonic())))
        except Exception as error:  # noqa: BLE001 (the thread would end unnoticed)
            self.failure = f'{str(self._contents.path)!r} was not played to its end: {error}'
            self.get_logger().error(escaped(self.failure))
        finally:
            sys.setswitchinterval(interval)
            gc.unfreeze()
            self.finished.set_result(None)

    def _wait_for_subscriptions(self) -> None:
        """Wait until present subscriptions have matched: they would miss earlier messages."""
        begin = changed = time.monotonic()
        alone = not others_here(self.context.get_domain_id())
        seen: list[int] = []
        while (now := time.monotonic()) < changed + _MATCHING and now < begin + _MAX_MATCHING:
            publishers = self._topic_publishers.values()
            counts = [each.get_subscription_count() for each in publishers]
            if counts != seen or not (alone or len(self.get_node_names()) > 1):
                seen, changed = counts, now
            time.sleep(0.02)

    def _messages(self) -> Iterator[Message]:
        """Yield the messages to play; before the first time, those that latched topics hold."""
        latched = None if self._has_begun else LatchedMessages(self._first)
        self._has_begun = True
        for message in self._contents.in_order():
            if id(message.topic) not in self._topic_publishers:
                continue
            if message.received >= self._first:
                if latched:
                    yield from latched.held()
                    latched = None
                yield message
            elif latched:
                latched.add(message)
        if latched:
            yield from latched.held()

    def _play(self) -> bool:
        """Play the bag once; return whether it came to its end."""
        before, tick = None, self._first
        for message in _ahead(self._messages()):
            if message.received >= self._first:
                if before is None:  # to read the first message took time
                    self._set_time(self._first)
                    before = self._first
                if abs(message.received - before) > _MAX_GAP:
                    self._jump(before, message.received)
                    tick = message.received
                before = message.received
                while self._clock_publisher and tick <= message.received:
                    if not self._wait_until(tick, is_message=False):
                        return False
                    self._publish_clock(tick)
                    tick += self._clock_period
                if not self._wait_until(message.received):
                    return False
            self._topic_publishers[id(message.topic)].publish(message.data)
            self.played += 1
        return True

    def _jump(self, before: int, to: int) -> None:
        """Continue with the bag's time `to` [ns], and warn of it."""
        self._set_time(to)
        self.get_logger().warning(
            f'the bag has a gap of {(to - before) / 1e9:.0f} s after '
            f'{(before - self._start) / 1e9:.1f} s: skipped'
        )

    def _publish_clock(self, at: int) -> None:
        """Publish the bag's time `at` [ns] on `/clock`, if the player has it."""
        if self._clock_publisher:
            self._clock_publisher.publish(ClockMessage(clock=to_header(at).stamp))

    def destroy_node(self) -> None:
        """End the playback and destroy the node."""
        self._keys.put('quit')
        if (thread := getattr(self, '_thread', None)) and thread is not threading.current_thread():
            thread.join()
        super().destroy_node()
