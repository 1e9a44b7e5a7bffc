"""Text of a stranger as one line, safe to show."""

from __future__ import annotations

import re

from barc_sim.errors import escaped


def without_addresses(text: str) -> str:
    """Return `text` without addresses in memory, which differ from run to run."""
    return re.sub(r' at 0x[0-9a-fA-F]+', '', text)


def one_line(text: str, width: int = 400) -> str:
    """Return `text` as one line of at most `width` characters, escaped."""
    line = ' '.join(escaped(text).split())
    return line if len(line) <= width else f'{line[: width - 1]}\N{HORIZONTAL ELLIPSIS}'
