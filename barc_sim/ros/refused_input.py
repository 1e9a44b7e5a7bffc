"""Counts the messages that a node refuses, and warns of them."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node


class RefusedInput:
    """Counts the invalid messages that a node refuses; logs rate-limited warnings.

    The logger's own throttle inspects the stack at each message, which takes 0.3 ms; here a
    suppressed warning costs next to nothing.
    """

    def __init__(self, node: Node) -> None:
        """Warn with the logger of `node`."""
        self.count = 0
        self._logger = node.get_logger()
        self._next: dict[str, float] = {}  # [s] when the next warning `about` this may be logged

    def add(self, describe: Callable[[], str]) -> None:
        """Count a message; `describe` is called only if a warning is logged."""
        self.count += 1
        self.warn(lambda: f'refused {describe()} ({self.count} refused so far)', 'refused')

    def warn(self, sentence: Callable[[], str], about: str = '', period: float = 1.0) -> None:
        """Log what `sentence` returns, at most once in a `period` [s] for what it is `about`.

        Use it for input that is odd, but not refused.
        """
        now = time.monotonic()
        if now >= self._next.get(about, 0.0):
            self._next[about] = now + period
            self._logger.warning(sentence())
