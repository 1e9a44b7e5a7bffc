"""Types of the commands' options: numbers within bounds, refused in a sentence."""

from __future__ import annotations

from argparse import ArgumentTypeError
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

GREATEST_PORT = 65_535
#: Where the Foxglove app looks first.
FOXGLOVE_PORT = 8765


def number(low: float, high: float) -> Callable[[str], float]:
    """Return what converts a text to a number between `low` and `high`, ends included."""

    def convert(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float('nan')
        if not low <= value <= high:
            raise ArgumentTypeError(f'{text!r} is not a number from {low:g} to {high:g}')
        return value

    return convert


def whole(low: int, high: int) -> Callable[[str], int]:
    """Return what converts a text to a whole number between `low` and `high`, ends included."""

    def convert(text: str) -> int:
        if not text.isdecimal() or not low <= int(text) <= high:
            raise ArgumentTypeError(f'{text!r} is not a whole number from {low} to {high}')
        return int(text)

    return convert
