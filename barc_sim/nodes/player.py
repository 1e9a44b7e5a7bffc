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
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.task import Future
from rosgraph_msgs.msg import Clock as ClockMessage

from barc_sim.bags.bounds import MAX_GAP
from barc_sim.bags.contents import Contents
from barc_sim.bags.messages import CDR
from barc_sim.bags.recording_settings import selected
from barc_sim.errors import UserError, escaped
from barc_sim.interfaces.topics import CLOCK
from barc_sim.nodes.latched_messages import LatchedMessages
from barc_sim.nodes.playback_clock import PlaybackClock
from barc_sim.ros.node_helpers import to_header
from barc_sim.ros.peers import others_here
from barc_sim.ros.topics import message_class, offer

if TYPE_CHECKING:
    import re
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from rclpy.publisher import Publisher

    from barc_sim.bags.messages import BagMessage, Topic

_SHOW_PERIOD = 0.1  #: [s]
_MATCHING = 1.0  #: [s] without a new subscription after which matching counts as complete
_MAX_MATCHING = 5.0  #: [s]
_ACK_TIMEOUT = 3.0  #: [s] to wait until the last messages are acknowledged
_BATCH = 20  #: messages read at a time
_BATCHES = 16  #: batches read ahead
_MAX_GAP = int(MAX_GAP * 1e9)  #: [ns] between two messages; a longer gap is skipped
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


def _ahead(messages: Iterator[BagMessage]) -> Iterator[BagMessage]:
    """Yield the messages; a thread reads ahead, so that a large one does not delay the others."""
    with ThreadPoolExecutor(1) as pool:
        batches = (pool.submit(list, islice(messages, _BATCH)) for _ in count())
        ahead = deque(islice(batches, _BATCHES))
        batch = ahead.popleft().result()
        while batch:
            ahead.append(next(batches))
            yield from batch
            batch = ahead.popleft().result()


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
        self._start = span.start or 0
        self._last = span.end
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
        self._has_begun = False  # whether messages have been played
        self._previous: int | None = None  # [ns] reception of the last message that was played
        self._tick = self._first  # [ns] the bag's next time for `/clock`
        self._thread: threading.Thread | None = None
        self._playback_clock = PlaybackClock(
            self._first,
            rate=playback.rate,
            is_paused=playback.start_paused,
            pause_period=1.0 / playback.clock if playback.clock else None,
            on_pause=self._publish_time,
        )

        self._topic_publishers: dict[int, Publisher] = {}  # by the identity of the topic
        self._create_publishers()
        self._clock_publisher: Publisher | None = None
        self._clock_period = 0  # [ns] of the bag's time
        if playback.clock:
            self._clock_publisher = self.create_publisher(ClockMessage, CLOCK, 10)
            self._clock_period = max(1, int(1e9 * playback.rate / playback.clock))

        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_SHOW_PERIOD, lambda: show(self.progress), clock=steady)

        self._thread = threading.Thread(target=self._run, name='player', daemon=True)
        self._thread.start()

    def _create_publishers(self) -> None:
        """Create the publishers of the topics to play."""
        names = selected(self._contents.names, self._playback.topics, self._playback.exclude)
        if self._playback.clock and CLOCK in names:
            names.remove(CLOCK)
        for name in names:
            self._add_publisher(name)
        if not self._topic_publishers:
            self.destroy_node()
            raise UserError(
                f'{str(self._contents.path)!r} has no topic that can be played: give other --topics'
            )

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
        now = min(max(self._playback_clock.now, self._first), self._last)
        passed = (now - self._start) / 1e9
        duration = (self._last - self._start) / 1e9
        pace = 'paused' if self._playback_clock.is_paused else f'x{self._playback.rate:g}'
        return f'{passed:7.1f} / {duration:.1f} s  {self.played} messages  {pace}'

    def on_key(self, key: str) -> None:
        """Handle a key: `space` pauses or resumes, `right` steps, and `quit` ends."""
        self._playback_clock.press(key)

    def _run(self) -> None:
        with suppress(OSError):  # without the permission, ordinary threads can delay this one
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))

        gc.freeze()  # to collect the present objects, too, would take 20 ms
        interval = sys.getswitchinterval()
        sys.setswitchinterval(_SWITCH)
        try:
            self._wait_for_subscriptions()
            has_ended = self._play()
            while has_ended and self._playback.loop:
                has_ended = self._play()
            if has_ended:
                self._wait_until_acknowledged()
        except Exception as error:  # noqa: BLE001 (the thread would end unnoticed)
            self.failure = f'{str(self._contents.path)!r} was not played to its end: {error}'
            self.get_logger().error(escaped(self.failure))
        finally:
            sys.setswitchinterval(interval)
            gc.unfreeze()
            self.finished.set_result(None)

    def _wait_for_subscriptions(self) -> None:
        """Wait until present subscriptions have matched: they would miss earlier messages."""
        begin = time.monotonic()
        changed = begin
        is_alone = not others_here(self.context.get_domain_id())
        counts: list[int] = []

        now = begin
        while now < changed + _MATCHING and now < begin + _MAX_MATCHING:
            before = counts
            counts = [each.get_subscription_count() for each in self._topic_publishers.values()]
            has_found_others = is_alone or len(self.get_node_names()) > 1
            if counts != before or not has_found_others:
                changed = now
            time.sleep(0.02)
            now = time.monotonic()

    def _wait_until_acknowledged(self) -> None:
        """Wait until the last messages have arrived, for some seconds at most."""
        end = time.monotonic() + _ACK_TIMEOUT
        for publisher in self._topic_publishers.values():
            left = max(0.0, end - time.monotonic())
            publisher.wait_for_all_acked(Duration(seconds=left))

    def _messages(self) -> Iterator[BagMessage]:
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
        self._previous = None
        self._tick = self._first
        for message in _ahead(self._messages()):
            is_timed = message.received >= self._first  # others were latched before the start
            if is_timed and not self._wait_for(message.received):
                return False
            self._topic_publishers[id(message.topic)].publish(message.data)
            self.played += 1
        return True

    def _wait_for(self, received: int) -> bool:
        """Wait until a message is due; return False at the key `quit`."""
        if self._previous is None:  # to read the first message took time
            self._playback_clock.set(self._first)
            self._previous = self._first
        if abs(received - self._previous) > _MAX_GAP:
            self._skip_gap(self._previous, received)
        self._previous = received

        while self._clock_publisher and self._tick <= received:
            if not self._playback_clock.wait_until(self._tick, is_message=False):
                return False
            self._publish_clock(self._tick)
            self._tick += self._clock_period
        return self._playback_clock.wait_until(received)

    def _skip_gap(self, before: int, to: int) -> None:
        """Continue with the bag's time `to` [ns], and warn of it."""
        self._playback_clock.set(to)
        self._tick = to
        self.get_logger().warning(
            f'the bag has a gap of {(to - before) / 1e9:.0f} s after '
            f'{(before - self._start) / 1e9:.1f} s: skipped'
        )

    def _publish_time(self) -> None:
        """Publish the present time of the bag: nodes that begin during a pause need it, too."""
        self._publish_clock(self._playback_clock.now)

    def _publish_clock(self, at: int) -> None:
        """Publish the bag's time `at` [ns] on `/clock`, if the player has it."""
        if self._clock_publisher:
            self._clock_publisher.publish(ClockMessage(clock=to_header(at).stamp))

    def destroy_node(self) -> None:
        """End the playback and destroy the node."""
        self._playback_clock.press('quit')
        if self._thread and self._thread is not threading.current_thread():
            self._thread.join()
        super().destroy_node()
