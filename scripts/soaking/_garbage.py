"""Messages of any type, filled with what is right and with what nobody should send."""

from __future__ import annotations

import re
from math import inf, nan
from typing import TYPE_CHECKING, Any

from barc_sim.ros.topics import message_class

if TYPE_CHECKING:
    import random

_FLOATS = (nan, inf, -inf, 1e308, -1e308, 5e-324, -0.0, 1e30)
_STRINGS = (
    '',
    '/controller',
    '/vehicle_simulator',
    'kp',
    'road',
    '\u2603 \x00\n\x1b[2J',
    'x' * 300,
)
_HUGE = 'x' * 100_000
#: How many in a thousand strings are huge.
_HUGE_SHARE = 2
_INTEGER = re.compile(r'(u?)int(\d+)')
_SEQUENCE = re.compile(r'sequence<([^,]+)(?:, \d+)?>')
_ARRAY = re.compile(r'(.+)\[(\d+)\]')
_NS = 10**9


class Garbage:
    """Fills messages; a `wild` one holds what is malformed, as far as its type lets it."""

    def __init__(self, chance: random.Random, now_ns: int) -> None:
        """Draw with `chance`; stamps are of about `now_ns` and of any other time."""
        self._chance = chance
        self._now = now_ns

    def of(self, name: str, *, wild: bool) -> Any:  # noqa: ANN401 (of any type)
        """Return a message of the type `name`, such as 'std_msgs/msg/Header'."""
        message = message_class(name)()
        if name == 'builtin_interfaces/msg/Time':
            message.sec, message.nanosec = self._stamp(wild=wild)
            return message
        for field, kind in message.get_fields_and_field_types().items():
            setattr(message, field, self._value(kind, wild=wild))
        return message

    def _stamp(self, *, wild: bool) -> tuple[int, int]:
        if wild and self._chance.random() < 0.3:  # noqa: PLR2004
            ends = (-(2**31), -1, 0, 2**31 - 1)
            return self._chance.choice(ends), self._chance.choice((0, 1, 2**32 - 1))
        spread = 70 if wild else 1
        return divmod(self._now + self._chance.randint(-spread * _NS, spread * _NS), _NS)

    def _value(self, kind: str, *, wild: bool) -> Any:  # noqa: ANN401, PLR0911
        chance = self._chance
        if found := _SEQUENCE.fullmatch(kind):
            return [self._value(found[1], wild=wild) for _ in range(chance.randint(0, 3))]
        if found := _ARRAY.fullmatch(kind):
            return [self._value(found[1], wild=wild) for _ in range(int(found[2]))]
        if found := _INTEGER.fullmatch(kind):
            bits = int(found[2]) - (not found[1])
            low = 0 if found[1] else -(2**bits)
            return chance.choice((low, 2**bits - 1, 0)) if wild else chance.randint(0, 9)
        if kind in {'double', 'float'}:
            # Some fields of a wild message are right.
            odd = wild and chance.random() < 0.7  # noqa: PLR2004
            return chance.choice(_FLOATS) if odd else chance.uniform(-1.0, 1.0)
        if kind == 'string':
            if wild and chance.randrange(1000) < _HUGE_SHARE:
                return _HUGE
            return chance.choice(_STRINGS) if wild else ''
        if kind == 'boolean':
            return chance.random() < 0.5  # noqa: PLR2004
        if kind in {'octet', 'byte'}:
            return bytes([chance.randrange(256)])
        package, name = kind.split('/')
        return self.of(f'{package}/msg/{name}', wild=wild)
