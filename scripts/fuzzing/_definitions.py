"""Definitions of messages, changed as texts: types, lengths, names, types within types."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from random import Random

_FIELD = re.compile(r'(\s*)([\w/]+)(\S*)(\s+)(\w+)(.*)')
_TYPES = (
    *('bool', 'byte', 'int32', 'uint32', 'uint64', 'float32', 'float64', 'string', 'string<=9'),
    *('wstring', 'time', 'Header', 'std_msgs/Header', 'builtin_interfaces/Time', 'a/B', 'ECU'),
    *('barc_interfaces/ZDynBkMdl', 'barc_interfaces/ControllerState'),
)
_SIZES = ('', '', '[]', '[0]', '[1]', '[<=3]', '[1000]', '[400000000]', '[18446744073709551616]')
_NAMES = ('x', 'sec', 'stamp', 'header', 'names', 'values', 'a', 'class', 'saturated', 'X')


def changed_definition(text: str, chance: Random) -> str:
    """Return a message definition with some changes."""
    lines = [line.partition('#')[0].rstrip() for line in text.splitlines()] or ['']

    for _ in range(chance.choice((1, 1, 1, 2, 5, 20))):
        _change(lines, chance)
    return '\n'.join(lines) + '\n'


def _change(lines: list[str], chance: Random) -> None:
    """Change a line, or insert or remove lines."""
    at = chance.randrange(len(lines))
    kind = chance.choice(_TYPES) + chance.choice(_SIZES)
    field = _FIELD.match(lines[at])

    match chance.randrange(8):
        case 0 | 1 | 2 if field:
            lines[at] = field.expand(rf'\1{kind}\4\5')
        case 3 | 4:
            lines.insert(at, f'{kind} {chance.choice(_NAMES)}')
        case 5:
            lines[at:at] = [f'{kind} {chance.choice(_NAMES)}{number}' for number in range(500)]
        case 6:
            for depth in range(60):
                size = chance.choice(_SIZES)
                lines += ['=' * 80, f'MSG: a/B{depth}', f'a/B{depth + 1}{size} a']
            lines.insert(0, f'a/B0{chance.choice(_SIZES)} a')
        case _:
            del lines[at]
            if not lines:
                lines.append('')
