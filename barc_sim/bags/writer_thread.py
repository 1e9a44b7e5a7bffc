"""The threads that take messages from a source, and write them into a bag."""

from __future__ import annotations

import errno
import threading
import time
from bisect import bisect_left
from collections import Counter
from operator import itemgetter
from typing import TYPE_CHECKING

from barc_sim.bags.appender import CHANGED
from barc_sim.bags.cache import MessageQueue, MessageRing
from barc_sim.bags.directory import MEBIBYTE, short_of_space
from barc_sim.bags.messages import BagMessage
from barc_sim.errors import UserError
from barc_sim.interfaces.stamps import NANOSECONDS, leading_time
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
#: [B] of messages that are written at once: other users of the bag wait so long.
_BATCH = 4 * MEBIBYTE
#: [ns] A poll is shorter, unless the system's clock was set meanwhile.
_MAX_POLL = NANOSECONDS

#: Returns the time of reception of a message.
_RECEIVED = itemgetter(BagMessage._fields.index('received'))
_REMOVED = 'it was removed while recording'


class WriterThread:
    """Polls a source and writes its messages into a bag, until it is closed.

    One thread takes messages from the source, another one writes them, so that a slow or full disk
    blocks only the latter. Meanwhile messages wait in a cache, up to its size; messages beyond it
    are lost, and counted. Without a cache they wait in the source. Writing is tried again until the
    disk accepts it.

    In snapshot mode the cache keeps the latest messages instead, and `snapshot` writes them.

    Parameters
    ----------
    writer
        The bag's writer; only the threads use it from now on.
    source
        Returns the waiting messages; called in the taking thread.
    reserve
        Space to leave free [B].
    on_failure
        Called in a thread with a sentence when writing fails; again only after it has worked.
    cache_size
        Size of the cache in memory [B]; 0: messages wait in the source.
    snapshot_mode
        Whether messages are only written by `snapshot`; that needs a cache.
    on_warning
        Called in a thread with a sentence when the recording goes on, but not as it should.
    """

    def __init__(
        self,
        writer: BagWriter,
        source: Callable[[], Iterable[MessageFields]],
        reserve: int,
        on_failure: Callable[[str], None],
        *,
        cache_size: int = 0,
        snapshot_mode: bool = False,
        on_warning: Callable[[str], None] | None = None,
    ) -> None:
        self._writer = writer
        self._source = source
        self._reserve = reserve
        self._on_failure = on_failure
        self._on_warning = on_warning

        # Settings.
        self.paused = False
        self.use_sim_time = False  #: whether messages are stamped with `/clock`, once there is one
        self.waits_for_clock = False  #: whether messages before the first `/clock` are left out
        self.writes_clock = True  #: whether `/clock` itself is written

        # Lost and omitted messages.
        self.before_clock = 0  #: number of messages left out before the first `/clock`
        self._unwritten: Counter[str] = Counter()  # by topic, after `close`
        self._warned_of_losses = False

        # Taking, under its lock.
        self._clock: int | None = None  # [ns] the latest `/clock`
        self._postponed: list[MessageFields] = []  # to the next poll
        self._last_count = 0  # number of messages in the last poll
        self._source_failed = False  # for good
        self._source_lock = threading.Lock()

        # Between the two.
        self._queue = MessageQueue(cache_size)
        self._ring = MessageRing(cache_size) if snapshot_mode else None
        self._cache = self._queue if self._ring is None else self._ring  # that takes messages

        # Writing, under its lock.
        self._stuck = False  # whether writing has failed and has not worked since
        self._writer_failed = False  # for good
        self._chunk_due = time.monotonic()
        self._lock = threading.RLock()

        self._closing = threading.Event()
        self._is_work_waiting = threading.Event()
        self._threads = [
            threading.Thread(target=run, name='recorder', daemon=True)
            for run in (self._run_taking, self._run_writing)
        ]

    def start(self) -> None:
        """Start the threads."""
        for thread in self._threads:
            thread.start()

    @property
    def unwritten(self) -> dict[str, int]:
        """The number of messages that were received and lost, by topic.

        Until `close` these are the messages that the cache could not take.
        """
        lost = self._unwritten + self._queue.lost
        if self._ring is not None:
            lost += self._ring.lost
        return dict(lost)

    # Taking

    def _run_taking(self) -> None:
        while not self._closing.wait(self._period):
            with self._source_lock:
                self._poll()

    @property
    def _period(self) -> float:
        return _BUSY_PERIOD if self._last_count > _MANY else _PERIOD

    def _poll(self) -> None:
        """Move the waiting messages from the source into the cache."""
        if self._source_failed or not self._has_room:
            return
        try:
            messages = self._take()
        except Exception as error:  # noqa: BLE001 (the thread would end unnoticed)
            self._source_failed = True
            self._report(error)
            return

        self._last_count = len(messages)
        if messages and not self.paused:
            self._cache.put(messages)
            self._is_work_waiting.set()
            self._warn_of_losses()

    @property
    def _has_room(self) -> bool:
        """Whether messages can be taken from the source."""
        if self._queue.max_size > 0:
            return True
        is_writing = not self._stuck and not self._writer_failed
        return is_writing and len(self._queue) == 0

    def _take(self) -> list[MessageFields]:
        """Return the waiting messages in order of reception, as readers expect.

        The source takes one topic after the other, so a message, or a `/clock`, older than another
        one may come with the next poll. Messages received since this poll began therefore wait for
        the next one.
        """
        poll_time = time.time_ns()
        messages = sorted([*self._postponed, *self._source()], key=_RECEIVED)
        count = bisect_left(messages, poll_time, key=_RECEIVED)
        was_clock_set_back = bool(messages) and _RECEIVED(messages[-1]) > poll_time + _MAX_POLL
        if self._closing.is_set() or was_clock_set_back:
            count = len(messages)

        self._postponed = messages[count:]
        if self.use_sim_time:
            return self._stamped(messages[:count])
        return messages[:count]

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

    def _warn_of_losses(self) -> None:
        """Warn of the first messages that the cache could not take."""
        if self._on_warning and not self._warned_of_losses and self.unwritten:
            self._warned_of_losses = True
            self._on_warning(
                f'messages are lost, as the cache of {self._queue.max_size} bytes is full: record '
                'to a faster disk, record fewer topics, or make the cache larger'
            )

    # Writing

    def _run_writing(self) -> None:
        while not self._closing.is_set():
            self._is_work_waiting.wait(max(0.0, self._chunk_due - time.monotonic()))
            self._is_work_waiting.clear()
            self._write_queue()

    def _write_queue(self) -> None:
        """Write the messages of the queue, and end a chunk if that is due."""
        is_more = True
        while is_more:
            with self._lock:
                is_more = self._write_batch()

    def _write_batch(self) -> bool:
        """Write some messages of the queue, end a chunk if due; return whether more can wait."""
        is_more = False
        try:
            if not self._stuck and not self._writer_failed:
                messages = self._queue.take(_BATCH)
                self._writer.write(messages)
                is_more = len(self._queue) > 0

            if time.monotonic() >= self._chunk_due:
                self._chunk_due = time.monotonic() + _CHUNK_PERIOD
                self._check_disk()
                self._writer.flush()
                self._stuck = False
        except OSError as error:
            self._fail(error)
        except Exception as error:  # noqa: BLE001 (the thread would end unnoticed)
            self._writer_failed = True
            self._fail(error)
        return is_more and not self._stuck

    def _check_disk(self) -> None:
        """Raise an OSError if the bag was removed or truncated, or the disk is short of space.

        The system does not report the former, and reports the latter too late.
        """
        if not self._writer.in_place:
            raise OSError(errno.ENOENT, _REMOVED)
        if not self._writer.is_whole:
            raise OSError(errno.ESTALE, CHANGED)
        try:
            shortage = short_of_space(self._writer.directory, self._reserve)
        except FileNotFoundError:  # at this very moment
            raise OSError(errno.ENOENT, _REMOVED) from None
        if shortage:
            raise OSError(errno.ENOSPC, shortage)

    def _fail(self, error: Exception) -> None:
        """Report a failure, unless the last one was reported and writing has not worked since."""
        if not self._stuck:
            self._stuck = True
            self._report(error)

    def _report(self, error: Exception) -> None:
        self._on_failure(f'writing to {str(self._writer.directory)!r} failed: {_reason(error)}')

    # Requests

    def write_now(self) -> None:
        """Write the waiting messages in the calling thread, unless the writer's threads do."""
        if self._source_lock.acquire(blocking=False):
            try:
                self._poll()
            finally:
                self._source_lock.release()
        if self._lock.acquire(blocking=False):
            try:
                self._write_queue()
            finally:
                self._lock.release()

    def pause(self) -> None:
        """Take the waiting messages, and leave out later ones, until `resume`."""
        with self._source_lock:
            self._poll()
            self.paused = True

    def resume(self) -> None:
        """Leave out the waiting messages, and take later ones."""
        with self._source_lock:
            self._poll()
            self.paused = False

    def do(self, action: Callable[[BagWriter], None]) -> None:
        """Call `action` with the bag's writer between two batches, unless the bag is closed."""
        with self._lock:
            try:
                if not self._writer.closed:
                    action(self._writer)
            except OSError as error:
                self._fail(error)

    def split(self) -> None:
        """Write the waiting messages, finish the file, and begin the next one.

        Raises
        ------
        UserError
            The disk refuses that now. The split comes once the disk accepts data again.
        """
        with self._source_lock:
            self._poll()
        with self._lock:
            if self._writer.closed:
                return
            self._write_queue()
            try:
                self._writer.split()
            except OSError as error:
                self._fail(error)
                raise UserError(
                    f'the bag {str(self._writer.directory)!r} cannot be split yet '
                    f'({_reason(error)}): make space'
                ) from error

    def snapshot(self) -> bool:
        """Write the messages of the cache, and empty it; return False without snapshot mode."""
        if self._ring is None:
            return False
        with self._source_lock:
            self._poll()
            self._queue.put(self._ring.take())
        self._is_work_waiting.set()
        return True

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
        self._is_work_waiting.set()
        for thread in self._threads:
            if thread.is_alive():
                thread.join()

        with self._source_lock, self._lock:
            self._reserve = 0  # space was kept free for this
            # The first pass resumes writing if the disk had refused a block.
            for _ in range(2):
                self._poll()
                self._chunk_due = 0.0
                self._write_queue()
            if not self._stuck:
                self._warn_of_removed_files()
                self._count_unwritten()
                self.do(lambda writer: writer.add_metadata(final_metadata()))
            self.do(lambda writer: writer.close())
            self._count_unwritten()

    def _warn_of_removed_files(self) -> None:
        """Warn of finished files that are gone; their messages count as lost."""
        removed = ', '.join(repr(str(path)) for path in self._writer.removed)
        if removed and self._on_warning:
            self._on_warning(
                f'files were removed while recording, and their messages count as lost: {removed}'
            )

    def _count_unwritten(self) -> None:
        """Count the messages that were received but never written."""
        counts = Counter(self._writer.counts)
        counts.subtract(self._writer.on_disk)
        waiting = [*self._queue.take(), *self._postponed]
        if self._stuck and not self._source_failed:
            waiting += self._source()
        counts.update(topic.name for topic, _, _, _, _ in waiting)
        self._unwritten = +counts


def _reason(error: Exception) -> str:
    """Return why something failed."""
    return getattr(error, 'strerror', None) or repr(error)
