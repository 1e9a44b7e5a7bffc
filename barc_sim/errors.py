"""What a user did that can't be done, in one sentence; and text that is safe to show."""

from __future__ import annotations

import re
from math import inf
from numbers import Integral, Real


def escaped(text: str) -> str:
    """Return `text` with the characters that control a terminal written as escapes."""
    return ''.join(
        c if c.isprintable() or c in '\n\t' else c.encode('unicode_escape').decode() for c in text
    )


def without_addresses(text: str) -> str:
    """Return `text` without addresses in memory, which differ from run to run."""
    return re.sub(r' at 0x[0-9a-fA-F]+', '', text)


def one_line(text: str, width: int = 400) -> str:
    """Return `text` as one line of at most `width` characters, escaped."""
    line = ' '.join(escaped(text).split())
    return line if len(line) <= width else f'{line[: width - 1]}\N{HORIZONTAL ELLIPSIS}'


def not_between(value: object, low: float, high: float) -> str:
    """Return why `value` is no number from `low` to `high`, ends included; '' where it is one.

    Where `low` is an int, whole numbers are meant.

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


class UserError(ValueError):
    """Names the value, what was expected and what to do; ends a command with exit code 2.

    Its text is shown on terminals, and names can come from a bag: they are escaped.

    Examples
    --------
    >>> print(UserError('kp=inf must be finite'))
    kp=inf must be finite
    """

    def __init__(self, message: str = '') -> None:
        super().__init__(escaped(message))
