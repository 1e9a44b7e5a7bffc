"""The node `bag_player`: publishes the messages of bags on their topics.

`playback_bags` reads the bags as one, `playback_publishers` has the topics' publishers, and
`playback_clock` the bag's time, which keys, parameters and services control (`playback_controls`,
`playback_rosbag2`).
"""

from __future__ import annotations

import gc
import os
import sys
import threading
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future
from rosgraph_msgs.msg import Clock as ClockMessage

from barc_sim.bags.bounds import MAX_GAP
from barc_sim.bags.playback_settings import Playback
from barc_sim.errors import UserError, escaped
from barc_sim.interfaces.topics import CLOCK
from barc_sim.nodes.playback_bags import PlaybackBags
from barc_sim.nodes.playback_clock import PlaybackClock, Wake
from barc_sim.nodes.playback_controls import PlaybackControls
from barc_sim.nodes.playback_publishers import PlaybackPublishers
from barc_sim.nodes.playback_rosbag2 import Rosbag2PlayerServices
from barc_sim.ros.conversions import to_header

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from rclpy.publisher import Publisher

_SHOW_PERIOD = 0.1  #: [s]
_MAX_GAP = int(MAX_GAP * 1e9)  #: [ns] between two messages; a longer gap is skipped
_SWITCH = 1e-4  #: [s] after which another thread gives up the interpreter's lock to the player


class BagPlayer(Node):
    """Publishes the messages of bags as they were sent: serialized, with their QoS and spacing.

    A thread of its own publishes; `finished` is done at the end. `controls` pause it, step, change
    its rate and let it continue elsewhere, by keys, parameters and services.

    Several bags are played as one, in order of reception. A topic whose type is not installed is
    left out, with a warning.

    UserError: there is no bag, none of its topics can be played, or there is nothing to play in
    the time span.

    Parameters
    ----------
    paths
        The MCAP bags, made by any recorder.
    playback
        What to play, and how.
    show
        Called with the line of progress, 10 times a second.
    options
        Options of `rclpy.node.Node`.
    """

    def __init__(
        self,
        paths: Sequence[Path],
        playback: Playback | None = None,
        show: Callable[[str], object] = str,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        playback = playback or Playback()
        self._playback = playback
        self._bags = PlaybackBags(paths)
        span = self._bags.span
        self._start = span.start or 0
        self._last = span.end
        self._first = self._start + int(playback.start_offset * 1e9)
        self._end = playback.end(self._first)
        self._check_span()
        self._limit = self._last if self._end is None else min(self._last, self._end)

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
        # A service that waits for messages must not delay the end.
        self.finished.add_done_callback(lambda _: self._playback_clock.stop())

        self._clock_publisher: Publisher | None = None
        if playback.clock:
            self._clock_publisher = self.create_publisher(ClockMessage, CLOCK, 10)
        try:
            self._topic_publishers = PlaybackPublishers(self, self._bags, playback)
            self.controls = PlaybackControls(
                self,
                self._playback_clock,
                start=self._start,
                first=self._first,
                last=self._limit,
            )
        except UserError:
            self.destroy_node()
            raise
        with suppress(ImportError, AttributeError):  # rosbag2's types are not installed
            Rosbag2PlayerServices(self, self._playback_clock, self.controls)

        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_SHOW_PERIOD, lambda: show(self.progress), clock=steady)

        self._thread = threading.Thread(target=self._run, name='player', daemon=True)
        self._thread.start()

    def _check_span(self) -> None:
        """Refuse a time span without messages."""
        if self._first > self._last:
            raise UserError(
                f'{self._bags.name} has {(self._last - self._start) / 1e9:.3f} s of messages: give '
                'a shorter --start-offset'
            )
        if self._end is not None and self._end < self._first:
            raise UserError(
                f'the playback would begin at {self._first / 1e9:.3f} s, after its end at '
                f'{self._end / 1e9:.3f} s: give a later --playback-until-sec'
            )

    @property
    def progress(self) -> str:
        """The line of progress."""
        now = min(max(self._playback_clock.now, self._first), self._limit)
        passed = (now - self._start) / 1e9
        duration = (self._last - self._start) / 1e9
        pace = 'paused' if self._playback_clock.is_paused else f'x{self._playback_clock.rate:g}'
        return f'{passed:7.1f} / {duration:.1f} s  {self.played} messages  {pace}'

    def _run(self) -> None:
        with suppress(OSError):  # without the permission, ordinary threads can delay this one
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))

        gc.freeze()  # to collect the present objects, too, would take 20 ms
        interval = sys.getswitchinterval()
        sys.setswitchinterval(_SWITCH)
        try:
            self._topic_publishers.wait_for_subscriptions(self._playback_clock)
            has_ended = self._play()
            while has_ended and self._playback.loop:
                has_ended = self._play()
            if has_ended:
                self._topic_publishers.wait_until_acknowledged()
        except Exception as error:  # noqa: BLE001 (the thread would end unnoticed)
            self.failure = f'{self._bags.name} was not played to its end: {error}'
            self.get_logger().error(escaped(self.failure))
        finally:
            sys.setswitchinterval(interval)
            gc.unfreeze()
            self.finished.set_result(None)

    def _play(self) -> bool:
        """Play the bags once; return whether they came to their end."""
        is_first_time = not self._has_begun
        self._has_begun = True
        self._playback_clock.set(self._first)
        wake = self._playback_clock.delay(self._playback.delay)
        if wake is Wake.DUE:
            wake = self._play_from(self._first, with_latched=is_first_time)
        while wake is Wake.SOUGHT:
            wake = self._play_from(self._playback_clock.take_sought(), with_latched=True)
        return wake is Wake.DUE

    def _play_from(self, start: int, *, with_latched: bool) -> Wake:
        """Play from the bag's time `start` [ns] to the end, and return why it ended."""
        self._previous = None
        self._tick = start
        messages = self._bags.messages(
            start, self._end, self._topic_publishers.topics, with_latched=with_latched
        )
        for message in messages:
            if message.received >= start:  # others were latched before the start
                wake = self._wait_for(message.received, start)
                if wake is not Wake.DUE:
                    return wake
            self._topic_publishers.publish(message)
            self.played += 1
        return self._playback_clock.wait_at_end()

    def _wait_for(self, received: int, start: int) -> Wake:
        """Wait until a message is due; the first one after `start` counts from there."""
        if self._previous is None:  # to read the first message took time
            self._playback_clock.set(start)
            self._previous = start
        if abs(received - self._previous) > _MAX_GAP:
            self._skip_gap(self._previous, received)
        self._previous = received

        while self._clock_publisher and self._tick <= received:
            wake = self._playback_clock.wait_until(self._tick, is_message=False)
            if wake is not Wake.DUE:
                return wake
            self._publish_clock(self._tick)
            self._tick += self._clock_period
        return self._playback_clock.wait_until(received)

    @property
    def _clock_period(self) -> int:
        """The bag's time between two messages on `/clock` [ns]."""
        frequency = self._playback.clock or 1.0
        return max(1, int(1e9 * self._playback_clock.rate / frequency))

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
        self._playback_clock.stop()
        if self._thread and self._thread is not threading.current_thread():
            self._thread.join()
        super().destroy_node()
