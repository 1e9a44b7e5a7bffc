"""Logging, time, timers, futures and executors, in one thread.

An arrival puts its receiver into the queue of the executor that has the receiver's node. The
executor calls callbacks in the order of arrival. When it has none left in simulated time, time
jumps to the next timer: a minute takes milliseconds, and every run has the same order.
"""

from __future__ import annotations

import inspect
import sys
import threading
import time
from collections import deque
from contextlib import contextmanager
from contextvars import ContextVar
from enum import IntEnum
from functools import partialmethod, total_ordering
from math import inf
from typing import TYPE_CHECKING, Any

from barc_sim.ros.local.messages import LACKS, message_type

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator

SECOND = 1_000_000_000  #: [ns]
_LONGEST_SLEEP = 0.1  #: [s] until an executor notices that another thread has shut down rclpy


class EndOfTimeError(BaseException):
    """Simulated time is over; not an Exception, so that user code does not catch it."""


class ExternalShutdownException(Exception):
    """rclpy has been shut down while an executor waited."""


class World:
    """What the nodes of a program share: the time, the graph, and rclpy's context.

    `now` returns the time [ns] that paces timers. `date` returns the time [ns] since the epoch, or
    since the start of simulated time.
    """

    end = inf  #: of simulated time [ns]
    flat_names: Collection[str] = ()  #: topics that ignore namespaces
    is_silent = False  #: whether nothing is logged
    is_ok = False  #: whether rclpy is initialised, and not shut down
    arguments: Any  #: of `--ros-args`

    def __init__(self, *, simulated: bool = False) -> None:
        self.simulated = simulated
        self.now_ns = 0
        self.now: Callable[[], int] = self._simulated_now if simulated else time.monotonic_ns
        self.date: Callable[[], int] = self.now if simulated else time.time_ns
        self.nodes: list[Any] = []
        self.log_levels: dict[str, int] = {}
        #: Runs while a program waits: the nodes around the program, such as the simulator.
        self.around: Executor | None = None

    def _simulated_now(self) -> int:
        return self.now_ns

    def ok(self) -> bool:
        return self.is_ok

    def all(self, kind: str, name: str) -> list[Any]:
        """Return all nodes' entities of a kind, such as `publishers`, with this full name."""
        entities = (each for node in self.nodes for each in getattr(node, kind))
        return [each for each in entities if each.topic_name == name]

    def sleep(self, nanoseconds: int) -> None:
        """Wait for this time [ns]."""
        if not self.simulated:
            time.sleep(nanoseconds / SECOND)
            return
        until = self.now_ns + nanoseconds
        while self.now_ns < until:
            self.pass_time(until)

    def pass_time(self, until: float) -> None:
        """In simulated time, run the next callback of `around`, or jump to `until` [ns]."""
        due = self.around.next_due() if self.around else inf
        if due > until or not self.around:
            self._jump(until)
        elif due <= self.now_ns or self._jump(due):
            self.around.run_once(due)

    def _jump(self, to: float) -> bool:
        """Set the time to `to` [ns]; return False if simulated time ends before."""
        if min(to, self.end) == inf:
            raise RuntimeError('this wait has no end: simulated time has no more events')
        self.now_ns = int(min(max(to, self.now_ns), self.end))
        if to < self.end:
            return True
        self.at_end()
        return False

    def at_end(self) -> None:
        """End the program; a subclass can give it more time instead."""
        raise EndOfTimeError


_current: ContextVar[World] = ContextVar('world', default=World())  # noqa: B039 (of all)
#: Returns the world of the running program.
current = _current.get


@contextmanager
def world(other: World) -> Iterator[World]:
    """Run the block in another world, in this thread."""
    token = _current.set(other)
    try:
        yield other
    finally:
        _current.reset(token)


LoggingSeverity = IntEnum(
    'LoggingSeverity', {'UNSET': 0, 'DEBUG': 10, 'INFO': 20, 'WARN': 30, 'ERROR': 40, 'FATAL': 50}
)


class Logger:
    """Writes to stderr and, for a node, to `/rosout`."""

    def __init__(self, name: str, world: World, rosout: Any = None) -> None:
        self.name = name
        self._world = world
        self.rosout = rosout
        self._last: dict[tuple[Any, int], float] = {}  # [s] of the last log, by line of code

    def set_level(self, level: int) -> None:
        self._world.log_levels[self.name] = level

    def get_effective_level(self) -> LoggingSeverity:
        name = self.name
        levels = self._world.log_levels
        while name and not levels.get(name):
            name = name.rpartition('.')[0]
        return LoggingSeverity(levels.get(name) or LoggingSeverity.INFO)

    def _log(
        self,
        severity: LoggingSeverity,
        message: str,
        *,
        throttle_duration_sec: float = 0.0,
        once: bool = False,
    ) -> bool:
        if self._world.is_silent or severity < self.get_effective_level():
            return False

        frame = sys._getframe(1)  # noqa: SLF001 (the caller)
        place = (frame.f_code, frame.f_lineno)
        now = self._world.now() / SECOND
        last = self._last.get(place)
        if last is not None and (once or now < last + throttle_duration_sec):
            return False
        self._last[place] = now

        sec, nanosec = divmod(self._world.date(), SECOND)
        time = f'{sec}.{nanosec:09d}'
        print(f'[{severity.name}] [{time}] [{self.name}]: {message}', file=sys.stderr, flush=True)  # noqa: T201
        if self.rosout:
            log = message_type('rcl_interfaces/msg/Log')(
                level=severity, name=self.name, msg=message
            )
            log.stamp.sec = sec
            log.stamp.nanosec = nanosec
            log.file = frame.f_code.co_filename
            log.function = frame.f_code.co_name
            log.line = frame.f_lineno
            self.rosout.publish(log)
        return True

    debug = partialmethod(_log, LoggingSeverity.DEBUG)
    info = partialmethod(_log, LoggingSeverity.INFO)
    warning = warn = partialmethod(_log, LoggingSeverity.WARN)
    error = partialmethod(_log, LoggingSeverity.ERROR)
    fatal = partialmethod(_log, LoggingSeverity.FATAL)


def get_logger(name: str) -> Logger:
    return Logger(name, current())


ClockType = IntEnum('ClockType', 'ROS_TIME SYSTEM_TIME STEADY_TIME')


@total_ordering
class Duration:
    """A span of time [ns]; the subclass `Time` is the span from the start of its clock."""

    clock_type: Any = None

    def __init__(self, *, seconds: float = 0, nanoseconds: int = 0) -> None:
        self.nanoseconds = int(seconds * SECOND) + int(nanoseconds)

    def _of(self, other: Any) -> int:
        if self.clock_type != other.clock_type:
            raise TypeError("Can't compare times with different clock types")
        return int(other.nanoseconds)

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self.nanoseconds == self._of(other)

    def __lt__(self, other: Any) -> bool:
        return self.nanoseconds < self._of(other)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        clock = f', clock_type={self.clock_type.name}' if self.clock_type else ''
        return f'{type(self).__name__}(nanoseconds={self.nanoseconds}{clock})'

    def to_msg(self) -> Any:
        sec, nanosec = divmod(self.nanoseconds, SECOND)
        name = f'builtin_interfaces/msg/{type(self).__name__}'
        return message_type(name)(sec=sec, nanosec=nanosec)


class Time(Duration):
    def __init__(
        self, *, seconds: float = 0, nanoseconds: int = 0, clock_type: Any = ClockType.SYSTEM_TIME
    ) -> None:
        super().__init__(seconds=seconds, nanoseconds=nanoseconds)
        self.clock_type = clock_type

    def __add__(self, other: Duration) -> Time:
        return Time(nanoseconds=self.nanoseconds + other.nanoseconds, clock_type=self.clock_type)

    def __sub__(self, other: Any) -> Any:
        if isinstance(other, Time):
            return Duration(nanoseconds=self.nanoseconds - self._of(other))
        return self + Duration(nanoseconds=-other.nanoseconds)

    @classmethod
    def from_msg(cls, msg: Any, clock_type: Any = ClockType.ROS_TIME) -> Time:
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec, clock_type=clock_type)


class Clock:
    def __init__(self, *, clock_type: Any = ClockType.SYSTEM_TIME) -> None:
        self.clock_type = clock_type
        self._world = current()

    def now(self) -> Time:
        steady = self.clock_type == ClockType.STEADY_TIME
        ns = self._world.now() if steady else self._world.date()
        return Time(nanoseconds=ns, clock_type=self.clock_type)


def not_async(callback: Any) -> Any:
    """Return a callback; TypeError: it is a coroutine function."""
    if inspect.iscoroutinefunction(callback):
        raise TypeError(f'an async callback {LACKS}')
    return callback


class Timer:
    """A timer of wall-clock or simulated time; when late, it skips the periods that have passed."""

    queue = None  #: a timer receives no messages

    def __init__(self, node: Any, period: int, callback: Any) -> None:
        self.node = node
        self.callback = not_async(callback)
        self.timer_period_ns = period
        self.due = inf  #: [ns]; infinity: it is cancelled
        self._now = node.context.now

    def _set(self, due: float) -> None:
        self.due = due
        if self.node.executor is not None:
            self.node.executor.check_timers(due)

    def run(self) -> None:
        """Call the callback, unless the timer was reset or cancelled meanwhile."""
        now = self._now()
        if now < self.due:
            return

        period = self.timer_period_ns
        due = now
        if period:
            late_periods = (now - self.due) // period
            due = self.due + period * (1 + late_periods)
        self._set(due)
        self.callback()

    def reset(self) -> None:
        self._set(self._now() + self.timer_period_ns)

    def cancel(self) -> None:
        self.due = inf

    destroy = cancel

    def is_canceled(self) -> bool:
        return self.due == inf


class Future:
    _result: Any = None
    is_done = False

    def __init__(self) -> None:
        self._callbacks: list[Callable[[Future], object]] = []

    def done(self) -> bool:
        return self.is_done

    def result(self) -> Any:
        return self._result

    def set_result(self, result: Any) -> None:
        self._result = result
        self.is_done = True
        while self._callbacks:
            self._callbacks.pop(0)(self)

    def add_done_callback(self, callback: Callable[[Future], object]) -> None:
        if self.is_done:
            callback(self)
        else:
            self._callbacks.append(callback)


class Executor:
    """Calls callbacks in one thread, in the order of arrival."""

    def __init__(self, num_threads: int | None = None) -> None:
        del num_threads
        self.world = current()
        self._nodes: list[Any] = []
        self.ready: deque[Any] = deque()
        self._soonest: float = 0  #: [ns] No timer is due before this time.
        self._is_shutdown = False
        self.waits = False
        self.awake = threading.Event()

    def __enter__(self) -> Executor:  # noqa: PYI034 (Self is newer than Python 3.10)
        return self

    def __exit__(self, *_: object) -> None:
        self.shutdown()

    def add_node(self, node: Any) -> bool:
        if node in self._nodes:
            return False
        if node.executor is not None:
            node.executor.remove_node(node)
        self._nodes.append(node)
        node.executor = self
        self.ready.extend(node.waiting())
        self.check_timers(0)
        return True

    def remove_node(self, node: Any) -> None:
        if node in self._nodes:
            self._nodes.remove(node)
            self.ready = deque(receiver for receiver in self.ready if receiver.node is not node)
            node.executor = None

    def check_timers(self, due: float) -> None:
        """Check the timers again at `due` [ns]; any thread may call this."""
        self._soonest = min(self._soonest, due)
        if self.waits:
            self.awake.set()

    def next_due(self) -> float:
        """Return when the next callback is due [ns]; infinity: none is."""
        if self.ready:
            return self.world.now()
        self._soonest = min((timer.due for timer in self._timers()), default=inf)
        return self._soonest

    def _timers(self) -> list[Timer]:
        return [timer for node in self._nodes for timer in node.timers]

    def run_once(self, until: float) -> bool:
        """Call one callback that is ready; otherwise wait for one, at most until `until` [ns]."""
        now = self.world.now()
        if now >= self._soonest:
            timers = sorted(self._timers(), key=lambda timer: timer.due)
            self.ready += [timer for timer in timers if timer.due <= now]
            self._soonest = min((timer.due for timer in timers if timer.due > now), default=inf)

        if self.ready:
            receiver = self.ready.popleft()
            if receiver.queue is None:
                receiver.run()  # a timer
            elif receiver.queue:
                receiver.callback(receiver.queue.popleft())
            return True

        self.waits = True
        try:
            self._wait(min(self.next_due(), until))
        finally:
            self.waits = False
        if not (self.world.is_ok or self._is_shutdown):
            raise ExternalShutdownException
        return False

    def _wait(self, until: float) -> None:
        if self.world.simulated:
            self.world.pass_time(until)
        else:
            left = (until - time.monotonic_ns()) / SECOND
            self.awake.wait(min(max(left, 0.0), _LONGEST_SLEEP))
            self.awake.clear()

    def spin(self) -> None:
        self._spin(Future(), None)

    def spin_until_future_complete(self, future: Future, timeout_sec: float | None = None) -> None:
        future.add_done_callback(lambda _: self.awake.set())
        self._spin(future, timeout_sec)

    def spin_once(self, timeout_sec: float | None = None) -> None:
        self._spin(Future(), timeout_sec, once=True)

    def _spin(self, future: Future, timeout: float | None, *, once: bool = False) -> None:
        until = inf
        if timeout is not None and timeout >= 0:
            until = self.world.now() + int(timeout * SECOND)
        while self.world.is_ok and not self._is_shutdown and not future.is_done:
            has_called = self.run_once(until)
            if has_called and once:
                return
            if until != inf and self.world.now() >= until:
                return

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        del timeout_sec
        self._is_shutdown = True
        for node in [*self._nodes]:
            self.remove_node(node)
        self.awake.set()
        return True


#: One thread calls all callbacks, so that none run at the same time.
SingleThreadedExecutor = MultiThreadedExecutor = Executor


class CallbackGroup:
    """A group without effect: all callbacks exclude one another."""


MutuallyExclusiveCallbackGroup = ReentrantCallbackGroup = CallbackGroup
