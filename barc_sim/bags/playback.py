"""The time of a playback: it goes on at a rate, stops during a pause, and steps."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import re
    from collections.abc import Sequence


class Playback(NamedTuple):
    """What to play of a bag, and how."""

    rate: float = 1.0
    loop: bool = False
    start_offset: float = 0.0  #: [s]
    start_paused: bool = False
    topics: Sequence[re.Pattern[str]] = ()  #: names, or what they contain; none: all
    exclude: Sequence[re.Pattern[str]] = ()
    clock: float | None = None  #: [Hz] of `/clock`; None: there is none but the bag's

    def selected(self, names: Sequence[str]) -> list[str]:
        """Return those of a bag's topics that are to be played."""

        def among(name: str, patterns: Sequence[re.Pattern[str]]) -> bool:
            return any(
                each.pattern == name if each.pattern in names else each.search(name)
                for each in patterns
            )

        return [
            name
            for name in names
            if (not self.topics or among(name, self.topics))
            and not among(name, self.exclude)
            and not (self.clock and name == '/clock')
        ]


class PlaybackClock:
    """The time [ns] in a bag that is played; for several threads."""

    def __init__(self, rate: float, *, paused: bool) -> None:
        self._rate = rate
        self._paused = paused
        self._steps = 0
        self._closed = False
        self._time, self._since = 0, time.monotonic_ns()  # the bag's time then
        self._changed = threading.Condition()

    def set(self, to: int) -> None:
        """Continue from the time `to`."""
        with self._changed:
            self._time, self._since = to, time.monotonic_ns()

    @property
    def now(self) -> int:
        """The time in the bag [ns]."""
        passed = 0 if self._paused else time.monotonic_ns() - self._since
        return self._time + int(passed * self._rate)

    @property
    def paused(self) -> bool:
        """Whether time stands still."""
        return self._paused

    def toggle(self) -> None:
        """Pause, or go on."""
        with self._changed:
            self._time, self._since = self.now, time.monotonic_ns()
            self._paused = not self._paused
            self._steps = 0
            self._changed.notify_all()

    def step(self) -> None:
        """Let one message go while time is paused."""
        with self._changed:
            self._steps += self._paused
            self._changed.notify_all()

    def close(self) -> None:
        """End every wait."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def wait_until(self, at: int, *, is_message: bool = True) -> bool:
        """Sleep until the time `at`, or until a step to it; return False once it is closed."""
        with self._changed:
            while not self._closed:
                if self._paused and self._steps:
                    self._steps -= is_message
                    self._time = max(at, self._time)
                    return True
                remaining = None if self._paused else (at - self.now) / self._rate / 1e9
                if remaining is not None and remaining <= 0.0:
                    return True
                self._changed.wait(remaining)
        return False
