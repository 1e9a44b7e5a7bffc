"""Types of the commands' options: numbers within bounds, refused in a sentence."""

from __future__ import annotations

from argparse import ArgumentTypeError
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

GREATEST_PORT = 65_535
#: The Foxglove app's default port.
FOXGLOVE_PORT = 8765


def number(low: float, high: float) -> Callable[[str], float]:
    """Return a converter from text to a number between `low` and `high`, ends included.

    Examples
    --------
    >>> number(0.0, 1.0)('0.5')
    0.5
    """

    def convert(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float('nan')
        if not low <= value <= high:
            raise ArgumentTypeError(f'{text!r} is not a number from {low:g} to {high:g}')
        return value

    return convert


def whole(low: int, high: int | None = None) -> Callable[[str], int]:
    """Return a converter from text to a whole number between `low` and `high`, ends included.

    Examples
    --------
    >>> whole(1)('3')
    3
    """
    bounds = f'from {low} to {high}' if high is not None else f'of at least {low}'

    def convert(text: str) -> int:
        if not text.isdecimal() or not low <= int(text) <= (int(text) if high is None else high):
            raise ArgumentTypeError(f'{text!r} is not a whole number {bounds}')
        return int(text)

    return convert
