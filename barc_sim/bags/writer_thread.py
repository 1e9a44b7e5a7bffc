"""The thread that writes messages into a bag."""

from __future__ import annotations

import errno
import threading
import time
from bisect import bisect_left
from collections import Counter
from operator import itemgetter
from typing import TYPE_CHECKING

from barc_sim.bags.appender import CHANGED
from barc_sim.bags.directory import short_of_space
from barc_sim.bags.messages import BagMessage
from barc_sim.interfaces.stamps import leading_time
from barc_sim.interfaces.topics import CLOCK

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from barc_sim.bags.messages import MessageFields
    from barc_sim.bags.writer import BagWriter

#: [s] between two polls of the source, during which the control loop waits for Python's lock.
_PERIOD = 0.1
#: [s] between two polls after one with more than `_MANY` messages: publishing slows down with the
#: messages that wait in DDS, and during a long poll the executor switches to another thread.
_BUSY_PERIOD = 0.01
_MANY = 100
#: [s] between the ends of two chunks. A kill loses the messages of this time and of one poll.
_CHUNK_PERIOD = 0.1

#: Returns the time of reception of a message.
_RECEIVED = itemgetter(BagMessage._fields.index('received'))


class WriterThread:
    """Polls a source and writes its messages into a bag, until it is closed.

    A slow or full disk blocks only this thread. Messages that the disk refuses wait here, and later
    messages wait in the source; each poll tries again. Nothing is lost while there is room.

    Parameters
    ----------
    writer
        The bag's writer; only the thread uses it from now on.
    source
        Returns the waiting messages; called in the thread.
    reserve
        Space to leave free [B].
    on_failure
        Called in the thread with a sentence when writing fails; again only after it has worked.
    """

    def __init__(
        self,
        writer: BagWriter,
        source: Callable[[], Iterable[MessageFields]],
        reserve: int,
        on_failure: Callable[[str], None],
    ) -> None:
        self._writer = writer
        self._source = source
        self._reserve = reserve
        self._on_failure = on_failure

        # Settings.
        self.paused = False
        self.use_sim_time = False  #: whether messages are stamped with `/clock`, once there is one
        self.waits_for_clock = False  #: whether messages before the first `/clock` are left out
        self.writes_clock = True  #: whether `/clock` itself is written

        # Lost and omitted messages.
        self.before_clock = 0  #: number of messages left out before the first `/clock`
        self.unwritten: dict[str, int] = {}  #: number of lost messages by topic, after `close`

        # State.
        self._clock: int | None = None  # [ns] the latest `/clock`
        self._postponed: list[MessageFields] = []  # to the next poll
        self._last_count = 0  # number of messages in the last poll
        self._stuck = False  # whether writing has failed and has not worked since
        self._source_failed = False  # for good
        self._chunk_due = time.monotonic()

        self._lock = threading.RLock()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name='recorder', daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def _run(self) -> None:
        while not self._closing.wait(self._period):
            with self._lock:
                self._run_once()

    @property
    def _period(self) -> float:
        return _BUSY_PERIOD if self._last_count > _MANY else _PERIOD

    def write_now(self) -> None:
        """Write the waiting messages in the calling thread, unless the writer's thread does."""
        if self._lock.acquire(blocking=False):
            try:
                self._run_once()
            finally:
                self._lock.release()

    def _run_once(self) -> None:
        """Write the waiting messages, and end a chunk if that is due."""
        try:
            # While writing fails, later messages wait in the source.
            if not self._stuck and not self._source_failed:
                self._drain()

            if time.monotonic() >= self._chunk_due:
                self._chunk_due = time.monotonic() + _CHUNK_PERIOD
                self._check_disk()
                self._writer.flush()
                self._stuck = self._source_failed
        except OSError as error:
            self._fail(error)
        except Exception as error:  # noqa: BLE001 (the thread would end unnoticed)
            self._source_failed = True
            self._fail(error)

    def _drain(self) -> None:
        messages = self._take()
        self._last_count = len(messages)
        if messages and not self.paused:
            self._writer.write(messages)

    def _take(self) -> list[MessageFields]:
        """Return the waiting messages in order of reception, as readers expect.

        The source takes one topic after the other, so a `/clock` older than a message may come with
        the next poll. Messages received since this poll began therefore wait for the next one.
        """
        poll_time = time.time_ns()
        messages = sorted([*self._postponed, *self._source()], key=_RECEIVED)
        if not self.use_sim_time:
            return messages

        if self._closing.is_set():
            count = len(messages)
        else:
            count = bisect_left(messages, poll_time, key=_RECEIVED)
        self._postponed = messages[count:]
        return self._stamped(messages[:count])

    def _stamped(self, messages: Iterable[MessageFields]) -> list[MessageFields]:
        """Set the time of reception of each message to the latest `/clock` before it.

        The messages are in order of reception. Messages before the first `/clock` keep their time,
        or are left out. When the clock jumps back, the times do, too. `ros2 bag record
        --use-sim-time` does the same, but in the order of its executor.
        """
        stamped: list[MessageFields] = []
        for topic, data, received, published, number in messages:
            if topic.name == CLOCK:
                self._clock = leading_time(data)
                if not self.writes_clock:
                    continue
            if self._clock is not None:
                stamped.append((topic, data, self._clock, published, number))
            elif not self.waits_for_clock:
                stamped.append((topic, data, received, published, number))
            elif not self.paused:
                self.before_clock += 1
        return stamped

    def _check_disk(self) -> None:
        """Raise an OSError if the bag was removed or truncated, or the disk is short of space.

        The system does not report the former, and reports the latter too late.
        """
        if not self._writer.in_place:
            raise OSError(errno.ENOENT, 'it was removed while recording')
        if not self._writer.is_whole:
            raise OSError(errno.ESTALE, CHANGED)
        shortage = short_of_space(self._writer.directory, self._reserve)
        if shortage:
            raise OSError(errno.ENOSPC, shortage)

    def _fail(self, error: Exception) -> None:
        """Report a failure, unless the last one was reported and writing has not worked since."""
        if not self._stuck:
            self._stuck = True
            reason = getattr(error, 'strerror', None) or repr(error)
            self._on_failure(f'writing to {str(self._writer.directory)!r} failed: {reason}')

    def do(self, action: Callable[[BagWriter], None]) -> None:
        """Call `action` with the bag's writer between two polls, unless the bag is closed."""
        with self._lock:
            try:
                if not self._writer.closed:
                    action(self._writer)
            except OSError as error:
                self._fail(error)

    def close(self, final_metadata: Callable[[], Mapping[str, str]] = dict) -> None:
        """Write the waiting messages and finish the bag; a second call does nothing.

        Parameters
        ----------
        final_metadata
            Returns metadata to add; called after the last message was taken.
        """
        if self._closing.is_set():
            return
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join()

        with self._lock:
            self._reserve = 0  # space was kept free for this
            # The first pass resumes writing if the disk had refused a block.
            for _ in range(2):
                self._chunk_due = 0.0
                self._run_once()
            if not self._stuck:
                self.do(lambda writer: writer.add_metadata(final_metadata()))
            self.do(lambda writer: writer.close())
            self._count_unwritten()

    def _count_unwritten(self) -> None:
        """Count the messages that were received but never written."""
        unwritten = Counter(self._writer.counts)
        unwritten.subtract(self._writer.on_disk)
        if self._stuck and not self._source_failed:
            waiting = [*self._postponed, *self._source()]
            unwritten.update(topic.name for topic, _, _, _, _ in waiting)
        self.unwritten = {topic: count for topic, count in unwritten.items() if count > 0}
