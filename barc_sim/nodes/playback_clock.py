"""The bag's time during a playback: it passes at a rate, can be paused, and jumps."""

from __future__ import annotations

import time
from enum import Enum
from math import inf
from threading import Condition
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

_SPIN = 2e-4  #: [s] of busy waiting before a message: a sleep ends late


class Wake(Enum):
    """Why a wait of the playback ended."""

    DUE = 'the time has come'
    SOUGHT = 'the time has jumped'
    STOPPED = 'the playback ends'


class PlaybackClock:
    """The time in a bag: one thread plays by it, and any thread controls it.

    Parameters
    ----------
    start
        The bag's time at first [ns].
    rate
        The bag's seconds per second.
    is_paused
        Whether to begin paused.
    pause_period
        Time between two calls of `on_pause` while the time is paused [s]; None: there are none.
    on_pause
        Called by the thread that plays.
    """

    def __init__(
        self,
        start: int,
        *,
        rate: float,
        is_paused: bool,
        pause_period: float | None,
        on_pause: Callable[[], None],
    ) -> None:
        self._rate = rate
        self._is_paused = is_paused
        self._pause_period = pause_period
        self._on_pause = on_pause

        self._changed = Condition()  # of any control
        self._changes = 0
        self._is_stopped = False
        self._is_delayed = False  # whether the time stands still as in a pause
        self._sought: int | None = None  # [ns] where to continue
        self._steps = 0.0  # messages still to publish while paused; infinity: all
        self._stepped = 0  # messages that were published so
        self._is_stepping = False  # whether the message of a step is being published
        self.set(start)

    def set(self, to: int) -> None:
        """Continue from the bag's time `to` [ns]."""
        with self._changed:
            self._time = to
            self._since = time.monotonic_ns()

    @property
    def now(self) -> int:
        """The time in the bag [ns]."""
        with self._changed:
            if self._is_paused or self._is_delayed:
                return self._time
            return self._time + int((time.monotonic_ns() - self._since) * self._rate)

    @property
    def is_paused(self) -> bool:
        """Whether the time is paused."""
        return self._is_paused

    @property
    def is_stopped(self) -> bool:
        """Whether the playback ends."""
        return self._is_stopped

    @property
    def rate(self) -> float:
        """The bag's seconds per second."""
        return self._rate

    def pause(self) -> None:
        """Let the time stand still."""
        self._set_paused(paused=True)

    def resume(self) -> None:
        """Let the time pass."""
        self._set_paused(paused=False)

    def toggle_pause(self) -> None:
        """Pause or resume."""
        with self._changed:
            self._set_paused(paused=not self._is_paused)

    def _set_paused(self, *, paused: bool) -> None:
        with self._changed:
            self.set(self.now)
            self._is_paused = paused
            self._steps = 0
            self._notify()

    def set_rate(self, rate: float) -> None:
        """Let the time pass at this rate from now on."""
        with self._changed:
            self.set(self.now)
            self._rate = rate
            self._notify()

    def stop(self) -> None:
        """End every wait, for good."""
        with self._changed:
            self._is_stopped = True
            self._steps = 0
            self._is_stepping = False
            self._notify()

    def seek(self, to: int) -> bool:
        """Let the playback continue at the bag's time `to` [ns]; return whether it does."""
        with self._changed:
            self._sought = to
            self._notify()
            self._changed.wait_for(lambda: self._is_stopped or self._sought is None)
            return not self._is_stopped

    def take_sought(self) -> int:
        """Return the time at which to continue [ns], and continue there."""
        with self._changed:
            to = self._time if self._sought is None else self._sought
            self._sought = None
            self.set(to)
            self._notify()
            return to

    def add_step(self) -> None:
        """Let one more message be published while the time is paused."""
        with self._changed:
            self._add_steps(1)

    def step(self, count: float = 1) -> int:
        """Let the next messages be published while the time is paused, and wait for it.

        Parameters
        ----------
        count
            Their number; infinity for all.

        Returns
        -------
        int
            How many were published: fewer than `count` at the end of the bag, and none unless the
            time is paused.
        """
        with self._changed:
            before = self._stepped
            self._add_steps(count)
            self._changed.wait_for(lambda: self._steps <= 0 and not self._is_stepping)
            return self._stepped - before

    def _add_steps(self, count: float) -> None:
        if self._is_paused and not self._is_stopped:
            self._steps += count
            self._notify()

    def _notify(self) -> None:
        self._changes += 1
        self._changed.notify_all()

    def wait_until(self, at: int, *, is_message: bool = True) -> Wake:
        """Wait until the bag's time `at` [ns] or a step to it.

        Only the thread that plays waits. After a message was due, its next wait means that the
        message has been published.
        """
        while True:
            with self._changed:
                self._end_step()
                wake = self._wake(at, is_message=is_message)
                if wake is not None:
                    return wake
                if self._is_paused:
                    self._wait_in_pause()
                    continue

                changes = self._changes
                due = self._since + int((at - self._time) / self._rate)  # by the monotonic clock
                left = (due - time.monotonic_ns()) / 1e9
                if left > _SPIN:
                    self._changed.wait(left - _SPIN)
            while self._changes == changes:
                if time.monotonic_ns() >= due:
                    return Wake.DUE

    def wait_at_end(self) -> Wake:
        """Wait at the end of the bag while the time is paused: there is no message to step to."""
        with self._changed:
            while True:
                self._end_step()
                self._steps = 0
                self._changed.notify_all()
                wake = self._wake(self._time, is_message=True)
                if wake is not None:
                    return wake
                self._wait_in_pause()

    def delay(self, seconds: float) -> Wake:
        """Let the time stand still for some `seconds`, as in a pause."""
        end = time.monotonic() + seconds
        with self._changed:
            self._is_delayed = True
            wake = self._request()
            left = seconds
            while wake is None and left > 0.0:
                self._wait_in_pause(left)
                wake = self._request()
                left = end - time.monotonic()
            self._is_delayed = False
            self.set(self._time)
        return wake or Wake.DUE

    def _wake(self, at: int, *, is_message: bool) -> Wake | None:
        """Return why not to wait for a time; None: it is later."""
        request = self._request()
        if request is not None:
            return request
        if self._steps > 0:
            if is_message:
                self._steps -= 1
                self._is_stepping = True
            self.set(max(at, self._time))
            return Wake.DUE
        return Wake.DUE if not self._is_paused and self.now >= at else None

    def _request(self) -> Wake | None:
        """Return the control that ends any wait."""
        if self._is_stopped:
            return Wake.STOPPED
        return None if self._sought is None else Wake.SOUGHT

    def _end_step(self) -> None:
        """Count a step whose message has been published."""
        if self._is_stepping:
            self._is_stepping = False
            self._stepped += 1
            self._changed.notify_all()

    def _wait_in_pause(self, seconds: float = inf) -> None:
        """Wait for a control, or for `seconds`, and announce the time of the pause."""
        period = min(seconds, inf if self._pause_period is None else self._pause_period)
        is_changed = self._changed.wait(None if period == inf else period)
        if not is_changed and period == self._pause_period:
            self._on_pause()
