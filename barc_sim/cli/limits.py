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
    whole = isinstance(low, int)
    kinds = (int, Integral) if whole else (float, int, Real)  # the first are quick to find
    if isinstance(value, kinds) and not isinstance(value, bool) and low <= value <= high:  # type: ignore[operator]
        return ''
    shown = f'{value:g}' if isinstance(value, float) and not whole else repr(value)
    span = f'from {low:g} to {high:g}'
    if whole:
        span = f'of at least {low}' if high == inf else f'from {low} to {high}'
    return f'{shown} is not a {"whole " * whole}number {span}'
