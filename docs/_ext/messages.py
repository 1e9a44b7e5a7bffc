"""What the .msg files of barc_interfaces declare."""

from __future__ import annotations

import re
from pathlib import Path

MESSAGES = Path(__file__).parents[2] / 'barc_interfaces' / 'msg'


def message(text: str) -> tuple[str, list[tuple[str, str, str]]]:
    """Return what a .msg file says at its beginning, and type, name and comment of its fields."""
    about, _, body = text.partition('\n\n')
    found = re.findall(r'^(\S+)\s+(\w+)[ \t]*(?:#\s*(.*))?$', body, re.MULTILINE)
    return ' '.join(line.lstrip('# ') for line in about.splitlines()), found
