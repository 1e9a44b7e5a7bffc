"""The sentence for a number that is out of its limits."""

from __future__ import annotations

from math import inf
from numbers import Integral, Real


def not_between(value: object, low: float, high: float) -> str:
    """Return why `value` is not a number from `low` to `high`, ends included; '' if it is one.

    If `low` is an int, the number must be whole.

    Examples
    --------
    >>> not_between(-1.0, 0.0, 1e3), not_between(1.5, 0, 9)
    ('-1 is not a number from 0 to 1000', '1.5 is not a whole number from 0 to 9')
    """
    if isinstance(low, int):
        return _not_whole(value, low, high)

    # float first: it is quick to check.
    if _is_number(value, (float, int, Real)) and low <= value <= high:  # type: ignore[operator]
        return ''
    return f'{_shown(value)} is not a number from {low:g} to {high:g}'


def _not_whole(value: object, low: int, high: float) -> str:
    """Return why `value` is not a whole number from `low` to `high`; '' if it is one."""
    if _is_number(value, (int, Integral)) and low <= value <= high:  # type: ignore[operator]
        return ''
    limits = f'of at least {low}' if high == inf else f'from {low} to {high}'
    return f'{_shown(value)} is not a whole number {limits}'


def _shown(value: object) -> str:
    """Return a value as it was typed, as nearly as that is known."""
    return f'{value:g}' if isinstance(value, float) else repr(value)


def _is_number(value: object, kinds: tuple[type, ...]) -> bool:
    """Return whether `value` is of these kinds; a truth is no number."""
    return isinstance(value, kinds) and not isinstance(value, bool)
