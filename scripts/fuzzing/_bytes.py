"""Changes to bytes, numbers and texts that a file's reader must bear."""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from random import Random

#: Texts that have led readers astray.
TEXTS = (
    '',
    'x' * 100_000,
    '[' * 5_000,
    '{"a":' * 2_000,
    '9' * 50_000,
    'a0: &a0 [x, x]\n' + ''.join(f'a{k}: &a{k} [*a{k - 1}, *a{k - 1}]\n' for k in range(1, 30)),
    '0:1,' * 20_000,
    '\x1b[2J\x1b]0;x\x07',
    '\0',
    '../../etc/passwd',
    '/' + 'a/' * 2_000,
    'nan',
    '-1e309',
    'null',
    '{}',
    '[]',
    '- {}\n- []\n',
    '\ud800'.encode('utf-8', 'surrogatepass').decode('latin-1'),
    json.dumps({'nodes': ['/a'] * 400, 'topics': {}, 'publications': [], 'subscriptions': []}),
    'float64 a\n' * 20_000,
    'float64[4294967295] a\nstring<=99999999999 b\n',
    'a/msg/B b\n' + '=' * 80 + '\nMSG: a/B\na/msg/B b\n',
    'zstd',
    'lz4',
    'cdr',
    'ros2msg',
    'student/../x',
    'student/bike_model.py/x',
)


def damage(content: bytes, chance: Random) -> bytes:
    """Return it with a few bytes changed, cut or inserted."""
    changed = bytearray(content)

    for _ in range(chance.randint(1, 8)):
        at = chance.randrange(len(changed) + 1)
        length = min(int(chance.expovariate(0.05)) + 1, 2000)

        match chance.choice(('change', 'cut', 'insert', 'end')):
            case 'change':
                changed[at : at + length] = chance.randbytes(len(changed[at : at + length]))
            case 'cut':
                del changed[at : at + length]
            case 'insert':
                changed[at:at] = chance.randbytes(length)
            case _:
                if chance.random() < 0.1:  # noqa: PLR2004 (else most files would be short)
                    del changed[at:]

    return bytes(changed)


def number(code: str, raw: bytes, chance: Random) -> bytes:
    """Return another number of the same size, little-endian."""
    size = struct.calcsize(code)
    maximum = (1 << 8 * size) - 1
    half = maximum >> 1
    value = int.from_bytes(raw[:size], 'little')

    numbers = (
        *(0, 1, 2, maximum, maximum - 1, half, half + 1),
        *(value + 1, value - 1, value * 2),
        value ^ 1 << chance.randrange(8 * size),  # one bit is another
        chance.randint(0, maximum),
    )
    return (chance.choice(numbers) & maximum).to_bytes(size, 'little')


def text(data: bytes, chance: Random) -> bytes:
    """Return another text, or damaged bytes that are none."""
    match chance.randrange(4):
        case 0:
            return damage(data, chance)
        case 1:
            return data + chance.choice(TEXTS).encode()
        case 2:
            return chance.randbytes(chance.randrange(40))
        case _:
            return chance.choice(TEXTS).encode()
