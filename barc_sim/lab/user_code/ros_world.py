"""A small ROS in one thread, with a clock of its own: runs a relay's program without ROS.

Messages reach the program's callbacks at their times, and timers fire at theirs, whenever the
program waits: in `spin`, in `sleep`. Nothing depends on the speed of the machine.
"""

from __future__ import annotations

import heapq
from itertools import count
from math import floor
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Event = Callable[[], object]

#: [s] that a question such as `rclpy.ok()` takes: a loop without a sleep comes to its end, too.
_QUESTION = 1e-3
_STATE_PERIOD = 0.02  #: [s]
_MOST_EVENTS = 200_000  #: of one program, also where its timer has no period
CMD_VEL, _STATE, COMMANDS = 'cmd_vel', 'z_vhcl', 'ecu'


class TimedTwist(NamedTuple):
    """A Twist on `cmd_vel`.

    Examples
    --------
    >>> TimedTwist(t=1.0, linear_x=1.0, angular_z=0.0)
    TimedTwist(t=1.0, linear_x=1.0, angular_z=0.0)
    """

    t: float  #: [s]
    linear_x: float
    angular_z: float


class Command(NamedTuple):
    """A command on `ecu`."""

    t: float  #: [s]
    motor: float
    servo: float


class WorldEnd(BaseException):
    """Ends the program at the end of its time; `except Exception` does not catch it."""


class Subscription(NamedTuple):
    """A callback for the messages of a topic."""

    topic: str
    kind: type  #: of its messages
    callback: Callable[[Any], object]
    queued: bool  #: whether it waits for the program to spin, as in ROS 2


class World:
    """Carries the messages of one program, from time 0 to `end` [s].

    Examples
    --------
    >>> world = World([TimedTwist(1.0, 1.0, 0.0)], end=5.0)
    >>> world.is_over()
    False
    """

    def __init__(self, twists: Sequence[TimedTwist], end: float) -> None:
        """Publish `twists` on `cmd_vel`, and the car's speed on `z_vhcl`."""
        self.now = 0.0  #: [s]
        self.end = end
        self.commands: list[Command] = []  #: published on `ecu`
        self.others: list[str] = []  #: the other topics that were published on
        self.subscriptions: list[Subscription] = []
        self._numbers = count()
        self._events: list[tuple[float, int, Event]] = []
        self._queue: list[Event] = []
        self._handled = 0
        self._speed = self._distance = 0.0
        for twist in twists:
            self.drive(twist)
        self.at(0.0, self._publish_state)

    def at(self, t: float, event: Event) -> None:
        """Call `event` at `t` [s]."""
        heapq.heappush(self._events, (t, next(self._numbers), event))

    def is_over(self) -> bool:
        """Return whether the time is over; the question takes a moment."""
        if self.now < self.end:
            self.wait(_QUESTION, spinning=False)
        return self.now >= self.end

    def wait(self, seconds: float, *, spinning: bool, once: bool = False) -> None:
        """Let time pass; where the program is `spinning`, its queued callbacks are called.

        With `once`, return after the first of them.
        """
        until = self.now + max(seconds, 0.0)
        while True:
            while spinning and self._queue:
                self._queue.pop(0)()
                if once:
                    return
            t = self._events[0][0] if self._events else until
            if min(t, until) >= self.end:
                self._move_to(self.end)
                self.wait_at_end()
            elif t <= until and self._events:
                _, _, event = heapq.heappop(self._events)
                self._move_to(max(t, self.now))
                event()
                self._handled += 1
                if self._handled > _MOST_EVENTS:
                    raise WorldEnd
            else:
                self._move_to(until)
                return

    def wait_at_end(self) -> None:
        """End the program, unless there is more time."""
        raise WorldEnd

    def wait_for_turn(self, period: float, last: float) -> float:
        """Let time pass to the next multiple of `period` [s] after `last` [s]; return it."""
        due = last + period * (floor((self.now - last) / period + 1e-9) + 1)
        self.wait(due - self.now, spinning=False)
        return due

    def deliver(self, event: Event, *, queued: bool) -> None:
        """Call `event` now, or when the program spins."""
        if queued:
            self._queue.append(event)
        else:
            event()

    def publish(self, topic: str, message: Any) -> None:  # noqa: ANN401 (a program's)
        """Take a message that the program publishes."""
        name = base(topic)
        if name != COMMANDS:
            if topic not in self.others:
                self.others.append(topic)
            return
        self.commands.append(Command(self.now, message.motor, message.servo))

    def _move_to(self, t: float) -> None:
        if self.commands:
            motor = self.commands[-1].motor
            if isinstance(motor, (int, float)):
                self._distance += self._speed * (t - self.now)
                self._speed += motor * (t - self.now)
        self.now = t

    def drive(self, twist: TimedTwist) -> None:
        """Publish a Twist on `cmd_vel` at its time."""
        self.at(twist.t, lambda: self._publish_twist(twist))

    def _publish_twist(self, twist: TimedTwist) -> None:
        def fill(message: Any) -> None:  # noqa: ANN401 (any message)
            message.linear.x, message.angular.z = float(twist.linear_x), float(twist.angular_z)

        self._send(CMD_VEL, fill)

    def _publish_state(self) -> None:
        def fill(message: Any) -> None:  # noqa: ANN401 (any message)
            message.x, message.v_x = self._distance, self._speed

        self._send(_STATE, fill)
        self.at(self.now + _STATE_PERIOD, self._publish_state)

    def _send(self, topic: str, fill: Callable[[Any], None]) -> None:
        for each in self.subscriptions:
            if base(each.topic) == topic:
                message = each.kind()
                fill(message)
                self.deliver(lambda e=each, m=message: e.callback(m), queued=each.queued)  # type: ignore[misc]


def base(topic: str) -> str:
    """Return a topic without its namespace: the lab's stock keyboard has `turtle1/cmd_vel`."""
    return str(topic).rpartition('/')[2]


class Timer:
    """Calls back every `period` [s] until `cancel`."""

    def __init__(self, world: World, period: float, callback: Event, *, queued: bool) -> None:
        """Begin one period from now."""
        self._world, self._period, self._callback = world, float(period), callback
        self._queued = queued
        self._on = True
        world.at(world.now + self._period, self._fire)

    def _fire(self) -> None:
        if self._on:
            self._world.deliver(self._callback, queued=self._queued)
            self._world.at(self._world.now + max(self._period, _QUESTION), self._fire)

    def cancel(self) -> None:
        """Stop."""
        self._on = False

    shutdown = cancel

    def reset(self) -> None:
        """Go on."""
        self._on = True
