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
