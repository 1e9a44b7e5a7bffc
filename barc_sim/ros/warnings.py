"""Rate-limited warnings, such as those about invalid input."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node


class RateLimitedWarning:
    """Warns at most once in a period.

    The logger's own throttle inspects the stack at each message, which takes 0.3 ms; here a
    suppressed warning costs next to nothing.
    """

    def __init__(self, node: Node, period: float = 1.0) -> None:
        """Warn with the logger of `node`, once in `period` [s] at most."""
        self._logger = node.get_logger()
        self._period, self._next = period, 0.0

    def warn(self, sentence: Callable[[], str]) -> None:
        """Log what `sentence` returns, unless the last warning is less than a period old."""
        now = time.monotonic()
        if now >= self._next:
            self._next = now + self._period
            self._logger.warning(sentence())


class RefusedInput:
    """Counts the invalid messages that a node refuses, and warns at most once a second."""

    def __init__(self, node: Node) -> None:
        """Warn with the logger of `node`."""
        self.count = 0
        self._warning = RateLimitedWarning(node)

    def add(self, describe: Callable[[], str]) -> None:
        """Count a message; `describe` is called only where a warning is logged."""
        self.count += 1
        self._warning.warn(lambda: f'refused {describe()} ({self.count} refused so far)')
