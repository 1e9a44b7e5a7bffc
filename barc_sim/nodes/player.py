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
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.task import Future
from rosgraph_msgs.msg import Clock as ClockMessage

from barc_sim.bags.contents import Contents
from barc_sim.bags.recording import selected
from barc_sim.errors import UserError
from barc_sim.ros.node_helpers import to_header
from barc_sim.ros.peers import others_here
from barc_sim.ros.topics import message_class, offer

if TYPE_CHECKING:
    import re
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from rclpy.publisher import Publisher

    from barc_sim.bags.messages import Message

_SHOW_PERIOD = 0.1  #: [s]
#: [s] without a new subscription after which matching counts as complete; its maximum time.
_MATCHING, _MAX_MATCHING = 1.0, 5.0
_ACK_TIMEOUT = 3.0  #: [s] to wait until the last messages are acknowledged
_SPIN = 2e-4  #: [s] of busy waiting before a message: a sleep ends late
_BATCH, _BATCHES = 20, 16  #: messages read at a time, and how many batches ahead
_SWITCH = 1e-4  #: [s] after which another thread gives up the interpreter's lock to the player


class Playback(NamedTuple):
    """What to play of a bag, and how."""

    rate: float = 1.0
    loop: bool = False
    start_offset: float = 0.0  #: [s]
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
        names = selected([*self._contents.topics], playback.topics, playback.exclude)
        if playback.clock and '/clock' in names:
            names.remove('/clock')
        self._topic_publishers = {name: each for name in names if (each := self._publisher(name))}
        if not self._topic_publishers:
            self.destroy_node()
            raise UserError(f'{str(path)!r} has no topic that can be played: give other --topics')
        clock = self.create_publisher(ClockMessage, '/clock', 10) if playback.clock else None
        self._clock_publisher = clock
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_SHOW_PERIOD, lambda: show(self.progress), clock=steady)
        self._thread = threading.Thread(target=self._run, name='player', daemon=True)
        self._thread.start()

    def _publisher(self, name: str) -> Publisher | None:
        topic = self._contents.topics[name]
        try:
            kind, qos = message_class(topic.type), offer(topic.offered_qos)
            return self.create_publisher(kind, name, qos)
        except Exception as error:  # noqa: BLE001 (a bag can have any names and types)
            reason = str(error).partition('\n')[0]
            self.get_logger().warning(f'{name} is not played: {reason}')
            return None

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
            with suppress(Empty):
                key = self._keys.get(timeout=left and max(0.0, left - _SPIN))
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
            self.get_logger().error(self.failure)
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

    def _play(self) -> bool:
        """Play the bag once; return whether it came to its end."""
        tick, publishers = self._first, self._topic_publishers
        wanted = (
            message
            for message in self._contents.in_order()
            if message.topic.name in publishers and message.received >= self._first
        )
        for number, message in enumerate(_ahead(wanted)):
            if not number:  # to read the first message took time
                self._set_time(self._first)
            while self._clock_publisher and self._playback.clock and tick <= message.received:
                if not self._wait_until(tick, is_message=False):
                    return False
                self._clock_publisher.publish(ClockMessage(clock=to_header(tick).stamp))
                tick += max(1, int(1e9 * self._playback.rate / self._playback.clock))
            if not self._wait_until(message.received):
                return False
            publishers[message.topic.name].publish(message.data)
            self.played += 1
        return True

    def destroy_node(self) -> None:
        """End the playback and destroy the node."""
        self._keys.put('quit')
        if (thread := getattr(self, '_thread', None)) and thread is not threading.current_thread():
            thread.join()
        super().destroy_node()
