"""What the tests of a cluster have its workers do; they import it."""

from __future__ import annotations

import time


def square_slowly(number: int) -> int:
    """Return the square of a number, after a while."""
    time.sleep(0.2)
    return number * number


def refuse() -> str:
    """Refuse all work."""
    return 'its kernel is too old'
