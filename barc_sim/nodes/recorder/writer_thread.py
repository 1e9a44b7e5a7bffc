"""Moves messages into a bag, in a thread of its own."""

from __future__ import annotations

import errno
import threading
import time
from collections import deque
from math import inf
from typing import TYPE_CHECKING

from barc_sim.nodes.recorder import disk_space
from barc_sim.nodes.recorder.sim_time import SimulatedTime

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from barc_sim.bags.writer import BagWriter
    from barc_sim.ros.topic_subscriptions import Message

#: [s] between two turns, each of which takes what has come meanwhile.
_PERIOD = 0.05
#: [s] between the ends of two chunks: a kill loses what came since the last, and up to a turn.
_CHUNK_PERIOD = 0.1


class Pump:
    """A thread that writes what a source has, until it is closed.

    A disk that is slow or full holds up nothing but this thread. What the disk refuses waits here,
    and the rest in the source, while each turn tries again: nothing is lost as long as that holds.

    Parameters
    ----------
    writer
        Of the bag; the pump's own from now on.
    source
        Returns the messages that wait; called in the thread.
    reserve
        Space to leave free [B].
    on_failure
        Is told, in the thread, what is wrong, when writing fails for the first time; then, when
        it goes on, None.
    """

    def __init__(
        self,
        writer: BagWriter,
        source: Callable[[], Iterable[Message]],
        reserve: int,
        on_failure: Callable[[str | None], None],
    ) -> None:
        self._lock = threading.Lock()
        self.paused = False
        self.use_sim_time = False  #: whether the bag's time is `/clock`'s, as soon as it is heard
        self._clock = SimulatedTime()
        self._late: list[Message] = []
        self.failure: str | None = None  #: the first one
        self._writer = writer
        self._source = source
        self._reserve = reserve
        self._on_failure = on_failure
        self._waiting: deque[Message] = deque()
        self._stuck = False  # until the disk takes again what it has refused
        self._broken = False  # for good: the source has failed
        self._chunk_due = time.monotonic()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name='recorder', daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def _run(self) -> None:
        while not self._closing.wait(_PERIOD):
            with self._lock:
                self._turn()

    def _turn(self) -> None:
        try:
            if not self._stuck and not self._broken:
                self._move()
            if time.monotonic() >= self._chunk_due:
                self._chunk_due = time.monotonic() + _CHUNK_PERIOD
                self._check()
                self._writer.flush()
                if self._stuck and not self._broken:
                    self._stuck = False
                    self._on_failure(None)
        except OSError as error:
            self._fail(error)
        except Exception as error:  # noqa: BLE001 (a thread's end would go unnoticed)
            self._broken = True
            self._fail(error)

    def _move(self) -> None:
        if not self._waiting:
            messages = self._take_simulated() if self.use_sim_time else self._source()
            if self.paused:
                return
            # In order of reception, as they would be read.
            self._waiting.extend(sorted(messages, key=_received))
        while self._waiting:
            topic, data, received, published, number = self._waiting.popleft()
            self._writer.write(topic, data, received=received, published=published, sequence=number)

    def _take_simulated(self) -> Iterable[Message]:
        """Return what waits, as received at the simulated time.

        Topics are taken one by one: what came since the first was begun with waits for the next
        turn, as a clock that came before it may.
        """
        begun = inf if self._closing.is_set() else time.time_ns()
        messages, self._late = [*self._late], []
        for message in self._source():
            (messages if message.received < begun else self._late).append(message)
        return self._clock.stamped(sorted(messages, key=_received))

    def _check(self) -> None:
        """Notice what the system would not tell, or too late.

        Raises
        ------
        OSError
            The bag was removed, and is there again; or space gets short.
        """
        if self._writer.restore():
            raise OSError(errno.ENOENT, 'it was removed under the recording, and is written anew')
        free = disk_space.free(self._writer.directory)
        if free < self._reserve:
            raise OSError(errno.ENOSPC, disk_space.short(free, self._reserve))

    def _fail(self, error: Exception) -> None:
        if not self._stuck:
            self._stuck = True
            reason = getattr(error, 'strerror', None) or repr(error)
            failure = f'writing to {str(self._writer.directory)!r} failed: {reason}'
            self.failure = self.failure or failure
            self._on_failure(failure)

    def add_metadata(self, entries: Mapping[str, str]) -> None:
        """Keep in the bag what the run says of itself."""
        with self._lock:
            self._try(lambda: self._writer.add_metadata(entries))

    def attach(self, files: Mapping[str, bytes]) -> None:
        """Keep files, by name, in the bag."""
        with self._lock:
            self._try(lambda: self._writer.attach(files))

    def split(self) -> None:
        """Go on in the bag's next file."""
        with self._lock:
            self._try(self._writer.split)

    def _try(self, action: Callable[[], None]) -> None:
        try:
            action()
        except OSError as error:
            self._fail(error)

    def close(self, last_words: Callable[[], Mapping[str, str]] = dict) -> None:
        """Write what waits and finish the bag; a second call does nothing.

        Parameters
        ----------
        last_words
            Returns metadata; called when the last message was taken.
        """
        if self._closing.is_set():
            return
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join()
        with self._lock:
            self._reserve = 0  # it was kept for this
            self._chunk_due = 0.0
            self._turn()  # makes it write again, where it could not
            self._chunk_due = 0.0
            self._turn()
            if not self._stuck:
                self._try(lambda: self._writer.add_metadata(last_words()))
            self._try(self._writer.close)


def _received(message: Message) -> int:
    return message.received
