"""The error of a user, as one sentence that is safe to show."""

from __future__ import annotations


def escaped(text: str) -> str:
    """Return `text` with the characters that control a terminal written as escapes."""
    return ''.join(
        c if c.isprintable() or c in '\n\t' else c.encode('unicode_escape').decode() for c in text
    )


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
