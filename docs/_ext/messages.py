"""What the .msg files of barc_interfaces declare."""

from __future__ import annotations

import re
from pathlib import Path

MESSAGES = Path(__file__).parents[2] / 'barc_interfaces' / 'msg'


def message(text: str) -> tuple[str, list[tuple[str, str, str]]]:
    """Return the comment at the top of a .msg file, and type, name and comment of its fields."""
    head, _, body = text.partition('\n\n')
    about = ' '.join(line.lstrip('# ') for line in head.splitlines())
    fields = re.findall(r'^(\S+)\s+(\w+)[ \t]*(?:#\s*(.*))?$', body, re.MULTILINE)
    return about, fields
