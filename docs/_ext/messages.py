"""What the .msg files of barc_interfaces declare."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

MESSAGES = Path(__file__).parents[2] / 'barc_interfaces' / 'msg'


class Field(NamedTuple):
    """A field of a message, as it is declared."""

    kind: str
    name: str
    comment: str


def message(text: str) -> tuple[str, list[Field]]:
    """Return the comment at the top of a .msg file, and its fields."""
    head, _, body = text.partition('\n\n')
    about = ' '.join(line.lstrip('# ') for line in head.splitlines())
    declarations = re.findall(r'^(\S+)\s+(\w+)[ \t]*(?:#\s*(.*))?$', body, re.MULTILINE)
    return about, [Field(*declaration) for declaration in declarations]
