"""Makes the text of submissions safe to show."""

from __future__ import annotations


def printable(text: str) -> str:
    """Return `text` without characters that control terminals or text direction."""
    return ''.join(
        c if c.isprintable() or c in '\n\t' else '\N{REPLACEMENT CHARACTER}' for c in text
    )


def one_line(text: str, width: int = 400) -> str:
    """Return `text` as one printable line of at most `width` characters."""
    line = ' '.join(printable(text).split())
    return line if len(line) <= width else f'{line[: width - 1]}\N{HORIZONTAL ELLIPSIS}'
