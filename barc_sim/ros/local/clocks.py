"""Time: the world's, of the wall or simulated; clocks, times and durations, timers.

In simulated time, where nothing is left to call, time jumps to the next timer: a minute takes
milliseconds, and always takes the same way.
"""

from __future__ import annotations

import time
from contextlib import contextmanager
from contextvars import ContextVar
from enum import IntEnum
from typing import TYPE_CHECKING, Any

from barc_sim.ros.local.messages import message_type

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

SECOND = 1_000_000_000  #: [ns]
_MOMENT = SECOND // 1000  #: that `rclpy.ok()` takes in simulated time, so that a loop ends


class EndOfTimeError(BaseException):
    """Simulated time is over; `except Exception` does not catch it."""


class World:
    """What the programs of one process share: the time and, by domain, the graph."""

    def __init__(
        self,
        *,
        simulated: bool = False,
        end: float = float('inf'),
        flat_names: Collection[str] = (),
        silent: bool = False,
    ) -> None:
        """Begin; `simulated` time lasts from 0 to `end` [s].

        Topics of the `flat_names` have no namespaces; a `silent` world has no log.
        """
        self.simulated, self.now_ns, self.end = simulated, 0, end * SECOND
        self.flat_names, self.silent = flat_names, silent
        self.contexts: dict[str, Any] = {}
        self.graphs: dict[int, Any] = {}
        self.log_levels: dict[str, int] = {}
        self.rosout: dict[str, Any] = {}
        #: Executors that run while others wait: the world around a program.
        self.around: list[Any] = []

    def now(self) -> int:
        """Return the time [ns] that paces timers."""
        return self.now_ns if self.simulated else time.monotonic_ns()

    def date(self) -> int:
        """Return the time [ns] since the epoch, or since the start of simulated time."""
        return self.now_ns if self.simulated else time.time_ns()

    def sleep(self, nanoseconds: int) -> None:
        """Let time pass."""
        if not self.simulated:
            time.sleep(nanoseconds / SECOND)
            return
        until = self.now_ns + nanoseconds
        while self.now_ns < until:
            self.pass_time(until)

    def pass_time(self, until: int | None) -> None:
        """In simulated time, run the next callback around, or jump to `until` [ns]."""
        waiting = [(due, each) for each in self.around if (due := each.next_due()) is not None]
        due, executor = min(waiting, key=lambda each: each[0], default=(until, None))
        if due is None:
            raise RuntimeError('nothing will ever end this wait: simulated time has no more events')
        if executor is None or (until is not None and due > until):
            self._jump(until)
        elif due <= self.now_ns or self._jump(due):
            executor.turn(due)

    def _jump(self, to: Any) -> bool:
        """Move time to `to` [ns], or to its end: False."""
        self.now_ns = int(min(max(to, self.now_ns), self.end))
        if to < self.end:
            return True
        self.at_end()
        return False

    def at_end(self) -> None:
        """End the program, unless there is more time."""
        raise EndOfTimeError


_installed = [World()]
_current: ContextVar[World | None] = ContextVar('world', default=None)


def current() -> World:
    """Return the world of the program that runs."""
    return _current.get() or _installed[0]


def set_world(other: World) -> World:
    """Make another world that of all programs that have none of their own."""
    _installed[0] = other
    return other


@contextmanager
def world(other: World) -> Iterator[World]:
    """Run what comes in another world, in this thread."""
    token = _current.set(other)
    try:
        yield other
    finally:
        _current.reset(token)


class ClockType(IntEnum):
    ROS_TIME = 1
    SYSTEM_TIME = 2
    STEADY_TIME = 3


class _Nanoseconds:
    """What times and durations share: they compare with their own kind."""

    __slots__ = ('clock_type', 'nanoseconds')
    nanoseconds: int
    clock_type: Any

    def _other(self, other: Any) -> int:
        if self.clock_type != other.clock_type:
            raise TypeError("Can't compare times with different clock types")
        return int(other.nanoseconds)

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self.nanoseconds == self._other(other)

    def __lt__(self, other: Any) -> bool:
        return (
            self.nanoseconds < self._other(other) if type(other) is type(self) else NotImplemented
        )

    def __le__(self, other: Any) -> bool:
        return (
            self.nanoseconds <= self._other(other) if type(other) is type(self) else NotImplemented
        )

    __hash__ = None  # type: ignore[assignment]


class Duration(_Nanoseconds):
    __slots__ = ()

    def __init__(self, *, seconds: float = 0, nanoseconds: int = 0) -> None:
        self.nanoseconds = int(seconds * SECOND) + int(nanoseconds)
        self.clock_type = None
        if not -(2**63) <= self.nanoseconds < 2**63:
            raise OverflowError('Total nanoseconds value is too large to store in C duration.')

    def __repr__(self) -> str:
        return f'Duration(nanoseconds={self.nanoseconds})'

    def __str__(self) -> str:
        return f'{self.nanoseconds} nanoseconds'

    def to_msg(self) -> Any:
        sec, nanosec = divmod(self.nanoseconds, SECOND)
        return message_type('builtin_interfaces/msg/Duration')(sec=sec, nanosec=nanosec)

    @classmethod
    def from_msg(cls, msg: Any) -> Duration:
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec)


class Time(_Nanoseconds):
    __slots__ = ()

    def __init__(
        self,
        *,
        seconds: float = 0,
        nanoseconds: int = 0,
        clock_type: ClockType = ClockType.SYSTEM_TIME,
    ) -> None:
        for name, value in (('Seconds', seconds), ('Nanoseconds', nanoseconds)):
            if value < 0:
                raise ValueError(f'{name} value must not be negative')
        self.nanoseconds, self.clock_type = int(seconds * SECOND) + int(nanoseconds), clock_type

    def __repr__(self) -> str:
        name = self.clock_type.name if self.clock_type else ''
        return f'Time(nanoseconds={self.nanoseconds}, clock_type={name})'

    def seconds_nanoseconds(self) -> tuple[int, int]:
        return divmod(self.nanoseconds, SECOND)

    def __add__(self, other: Duration) -> Time:
        if not isinstance(other, Duration):
            return NotImplemented
        return type(self)(
            nanoseconds=self.nanoseconds + other.nanoseconds, clock_type=self.clock_type
        )

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        if isinstance(other, Time):
            if self.clock_type != other.clock_type:
                raise TypeError("Can't subtract times with different clock types")
            return Duration(nanoseconds=self.nanoseconds - other.nanoseconds)
        if not isinstance(other, Duration):
            return NotImplemented
        if other.nanoseconds > self.nanoseconds:
            raise ValueError('Subtraction leads to negative time.')
        return self + Duration(nanoseconds=-other.nanoseconds)

    def to_msg(self) -> Any:
        sec, nanosec = divmod(self.nanoseconds, SECOND)
        return message_type('builtin_interfaces/msg/Time')(sec=sec, nanosec=nanosec)

    @classmethod
    def from_msg(cls, msg: Any, clock_type: ClockType = ClockType.ROS_TIME) -> Time:
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec, clock_type=clock_type)


class Clock:
    """A clock; one of ROS time follows `/clock` where its node has `use_sim_time`."""

    def __init__(self, *, clock_type: ClockType = ClockType.SYSTEM_TIME) -> None:
        self.clock_type, self.world = clock_type, current()
        self.override: int | None = None  # [ns] of `/clock`
        self.timers: list[Timer] = []

    @property
    def ros_time_is_active(self) -> bool:
        return self.override is not None

    def now(self) -> Time:
        steady = self.clock_type == ClockType.STEADY_TIME
        ns = self.world.now() if steady else self.world.date()
        return Time(
            nanoseconds=ns if self.override is None else self.override, clock_type=self.clock_type
        )

    def pace(self) -> int:
        """Return the time [ns] by which timers of this clock are due."""
        return self.world.now() if self.override is None else self.override

    def set_ros_time_override(self, to: Time | None) -> None:
        """Follow `/clock`, or no longer; timers keep the time that they still wait."""
        changed = (to is None) != (self.override is None)
        before = self.pace()
        self.override = None if to is None else to.nanoseconds
        for timer in self.timers:
            if changed and timer.due is not None:
                timer.due += self.pace() - before
            timer.schedule()

    def sleep_for(self, rel_time: Duration, context: Any = None) -> bool:
        until = self.pace() + rel_time.nanoseconds
        while (left := until - self.pace()) > 0:
            self.world.sleep(left if self.override is None else _MOMENT)
            if context and not context.ok():
                return False
        return True

    def sleep_until(self, until: Time, context: Any = None) -> bool:
        return self.sleep_for(Duration(nanoseconds=(until - self.now()).nanoseconds), context)


class ROSClock(Clock):
    def __init__(self) -> None:
        super().__init__(clock_type=ClockType.ROS_TIME)


class Timer:
    """Calls back by its clock; a late one leaves out the periods that have passed."""

    def __init__(self, node: Any, period: int, callback: Any, clock: Clock, group: Any) -> None:
        self.node, self.callback, self.clock, self.callback_group = node, callback, clock, group
        self.timer_period_ns = period
        self.due: int | None = None
        self._called = clock.pace()
        clock.timers.append(self)

    def schedule(self) -> None:
        """Enter the executor's agenda; by `/clock`, be called once its time has come."""
        if self.due is None or not (executor := self.node.executor):
            return
        if self.clock.override is None:
            executor.at(self.due, self)
        elif self.due <= self.clock.override:
            executor.push(self)

    def run(self) -> Any:
        """Call back, if it is still time."""
        now = self.clock.pace()
        if self.due is None or now < self.due:
            return None
        period, self._called = self.timer_period_ns, now
        self.due += period * (1 + (now - self.due) // period) if period else now - self.due
        self.schedule()
        return self.callback()

    def reset(self) -> None:
        self._called = self.clock.pace()
        self.due = self._called + self.timer_period_ns
        self.schedule()
        self.node.wake()

    def cancel(self) -> None:
        self.due = None

    def is_canceled(self) -> bool:
        return self.due is None

    def is_ready(self) -> bool:
        return self.due is not None and self.due <= self.clock.pace()

    def time_since_last_call(self) -> int:
        return self.clock.pace() - self._called

    def time_until_next_call(self) -> int | None:
        return None if self.due is None else self.due - self.clock.pace()

    def destroy(self) -> None:
        self.cancel()
        self.clock.timers.remove(self)


class Rate:
    """Sleeps to the next multiple of its period."""

    def __init__(self, period: float, clock: Clock, context: Any) -> None:
        self._period, self._clock, self._context = int(period * SECOND), clock, context
        self._due = clock.pace() + self._period

    def sleep(self) -> None:
        late = max(self._clock.pace() - self._due, 0)
        self._due += self._period * -(-late // self._period)
        left = Duration(nanoseconds=self._due - self._clock.pace())
        self._due += self._period
        if not self._clock.sleep_for(left, self._context):
            raise RuntimeError('rclpy.shutdown() has been called')

    def destroy(self) -> None:
        """Nothing is held."""
