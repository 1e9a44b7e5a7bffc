"""Clocks, points in time and durations."""

from __future__ import annotations

from enum import IntEnum
from functools import total_ordering
from typing import Any

from barc_sim.ros.local.messages import message_type
from barc_sim.ros.local.world import SECOND, current

ClockType = IntEnum('ClockType', 'ROS_TIME SYSTEM_TIME STEADY_TIME')


@total_ordering
class Duration:
    """A span of time [ns]; the subclass `Time` is the span from the start of its clock.

    Parameters
    ----------
    seconds, nanoseconds
        The two parts of the span, [s] and [ns].
    """

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
        """Return a message, of the type with the name of this class."""
        sec, nanosec = divmod(self.nanoseconds, SECOND)
        name = f'builtin_interfaces/msg/{type(self).__name__}'
        return message_type(name)(sec=sec, nanosec=nanosec)


class Time(Duration):
    """A point in time.

    Parameters
    ----------
    seconds, nanoseconds
        Its distance from the start of the clock, [s] and [ns].
    clock_type
        The clock; times of different clocks cannot be compared.
    """

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
        """Return the point in time of a message, on a clock."""
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec, clock_type=clock_type)


class Clock:
    """A clock.

    Parameters
    ----------
    clock_type
        A steady clock has the time that paces timers, any other one the date. In simulated time,
        both are the same.
    """

    def __init__(self, *, clock_type: Any = ClockType.SYSTEM_TIME) -> None:
        self.clock_type = clock_type
        self._world = current()

    def now(self) -> Time:
        """Return the present time."""
        nanoseconds = self._world.date()
        if self.clock_type == ClockType.STEADY_TIME:
            nanoseconds = self._world.now()
        return Time(nanoseconds=nanoseconds, clock_type=self.clock_type)
