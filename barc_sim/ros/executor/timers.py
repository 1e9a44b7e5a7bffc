"""Waits for all timers of an executor with one timerfd."""

from __future__ import annotations

import os
import time
from math import inf
from typing import TYPE_CHECKING

from rclpy.clock import JumpThreshold, ROSClock
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle

from barc_sim.ros.executor.descriptors import counter, retire, set_time, timerfd
from barc_sim.ros.executor.rclpy_private import set_listener

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.clock import JumpHandle

    from barc_sim.ros.executor.entities import Entry

_ANY_JUMP = JumpThreshold(
    min_forward=Duration(nanoseconds=1), min_backward=Duration(nanoseconds=-1)
)


class Timers:
    """When each timer is due.

    `descriptor` is readable when one is, `resets` when a timer was reset.

    Parameters
    ----------
    is_ready
        Called with the entry of a timer that is due.
    on_jump
        Called in any thread when simulated time has changed; `schedule_all` is to follow.
    """

    def __init__(self, is_ready: Callable[[Entry], None], on_jump: Callable[[], None]) -> None:
        self.descriptor = timerfd()
        self.resets = counter()
        self._is_ready = is_ready
        self._on_jump = on_jump
        self._armed: float = inf
        self._due: dict[Entry, float] = {}  # [ns] of the monotonic clock; inf: not by itself
        self._jumps: dict[Entry, JumpHandle] = {}

    def add(self, entry: Entry) -> None:
        """Wait for a timer."""
        if isinstance(entry.entity.clock, ROSClock):
            self._jumps[entry] = entry.entity.clock.create_jump_callback(
                _ANY_JUMP, post_callback=lambda _: self._on_jump()
            )
        set_listener(entry.entity, self.resets)
        self.schedule(entry)

    def remove(self, entry: Entry) -> None:
        """Wait for a timer no longer."""
        set_listener(entry.entity, None)
        if entry in self._jumps:
            self._jumps.pop(entry).unregister()
        self._due.pop(entry, None)

    def schedule(self, entry: Entry) -> None:
        """Find out when a timer is due, after it was called or may have been changed."""
        left = None
        try:
            with entry.handle:
                left = entry.handle.time_until_next_call()
        except InvalidHandle:
            pass
        due = inf
        if left is not None and left <= 0:
            if not entry.pending:  # else it waits for its group already
                self._is_ready(entry)
        elif left and not (entry in self._jumps and entry.entity.clock.ros_time_is_active):
            due = time.monotonic_ns() + left
        self._due[entry] = due
        if due < self._armed:
            self._arm(due)

    def schedule_all(self) -> None:
        """Find out when each timer is due."""
        for entry in list(self._due):
            self.schedule(entry)

    def expire(self) -> None:
        """Report the timers that are due, as `descriptor` was found readable."""
        now = time.monotonic_ns()
        self._armed = -inf
        for entry in [each for each, due in self._due.items() if due <= now]:
            self.schedule(entry)
        self._arm(min(self._due.values(), default=inf))

    def _arm(self, due: float) -> None:
        self._armed = due
        set_time(self.descriptor, due)

    def close(self) -> None:
        """Close the descriptors, when all timers were removed."""
        os.close(self.descriptor)
        retire(self.resets)
