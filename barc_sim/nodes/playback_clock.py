"""The bag's time during a playback: it passes at a rate, and keys pause it or step through it."""

from __future__ import annotations

import time
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

_SPIN = 2e-4  #: [s] of busy waiting before a message: a sleep ends late


class PlaybackClock:
    """The time in a bag, for the thread that plays it; keys come from any thread."""

    def __init__(
        self,
        start: int,
        *,
        rate: float,
        is_paused: bool,
        pause_period: float | None,
        on_pause: Callable[[], None],
    ) -> None:
        """Begin at the bag's time `start` [ns].

        `rate` is the bag's seconds per second. While time is paused, `on_pause` is called every
        `pause_period` [s], or never if that is None.
        """
        self._rate = rate
        self.is_paused = is_paused
        self._pause_period = pause_period
        self._on_pause = on_pause

        self._keys: SimpleQueue[str] = SimpleQueue()
        self._steps = 0  # messages to publish while paused
        self.set(start)

    def set(self, to: int) -> None:
        """Continue from the bag's time `to` [ns]."""
        self._time = to
        self._since = time.monotonic_ns()

    @property
    def now(self) -> int:
        """The time in the bag [ns]."""
        if self.is_paused:
            return self._time
        return self._time + int((time.monotonic_ns() - self._since) * self._rate)

    def press(self, key: str) -> None:
        """Handle a key: `space` pauses or resumes, `right` steps, and `quit` ends."""
        self._keys.put(key)

    def wait_until(self, at: int, *, is_message: bool = True) -> bool:
        """Wait until the bag's time `at` [ns] or a step; return False at the key `quit`."""
        while True:
            left = None if self.is_paused else (at - self.now) / self._rate / 1e9
            key = self._next_key(left)
            if key == 'quit':
                return False
            if key == 'space':
                self._toggle_pause()
            elif key == 'right' and self.is_paused:
                self._steps += 1

            if self._steps:
                if is_message:
                    self._steps -= 1
                self.set(max(at, self._time))
                return True
            if not key and left is not None and left <= 0.0:
                return True

    def _next_key(self, left: float | None) -> str:
        """Return a key; empty: none was pressed in the `left` [s]. None: time is paused."""
        timeout = self._pause_period if left is None else max(0.0, left - _SPIN)
        try:
            return self._keys.get(timeout=timeout)
        except Empty:
            if left is None:
                self._on_pause()
            return ''

    def _toggle_pause(self) -> None:
        self.set(self.now)
        self.is_paused = not self.is_paused
        self._steps = 0
