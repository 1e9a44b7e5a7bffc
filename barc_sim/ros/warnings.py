"""Warnings that whoever sends nonsense could call for a thousand times a second."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

#: [s]
_PERIOD = 1.0


class SeldomWarning:
    """Warns once a second at most.

    The logger's own throttle looks at the stack for each message, for 0.3 ms; this costs next to
    nothing between two warnings.
    """

    def __init__(self, node: Node) -> None:
        """Warn as `node`."""
        self._logger = node.get_logger()
        self._next = 0.0

    def warn(self, sentence: Callable[[], str]) -> None:
        """Warn, if it is time again."""
        now = time.monotonic()
        if now >= self._next:
            self._next = now + _PERIOD
            self._logger.warning(sentence())


class Refusals:
    """What a node refuses: counted, and warned of once a second."""

    def __init__(self, node: Node) -> None:
        """Nothing refused yet."""
        self.count = 0
        self._warning = SeldomWarning(node)

    def add(self, what: Callable[[], str]) -> None:
        """Count one; `what` says what it was, where that is to be told."""
        self.count += 1
        self._warning.warn(lambda: f'refused {what()} ({self.count} refused up to now)')
