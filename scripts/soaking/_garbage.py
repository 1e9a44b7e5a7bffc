"""Messages of any type, with right values and with values that nobody should send."""

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
    """Makes messages; a `wild` one has malformed values, as far as its type lets it.

    Parameters
    ----------
    chance
        The values are drawn from it.
    now_ns
        [ns] Stamps are of about this time, or of any other time.
    """

    def __init__(self, chance: random.Random, now_ns: int) -> None:
        self._chance = chance
        self._now = now_ns

    def message(self, name: str, *, wild: bool) -> Any:  # noqa: ANN401 (of any type)
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
            seconds = self._chance.choice((-(2**31), -1, 0, 2**31 - 1))
            return seconds, self._chance.choice((0, 1, 2**32 - 1))

        spread = 70 if wild else 1
        return divmod(self._now + self._chance.randint(-spread * _NS, spread * _NS), _NS)

    def _value(self, kind: str, *, wild: bool) -> Any:  # noqa: ANN401
        """Return a value for a field, whose type is named as in a message definition."""
        sequence = _SEQUENCE.fullmatch(kind)
        if sequence:
            count = self._chance.randint(0, 3)
            return [self._value(sequence[1], wild=wild) for _ in range(count)]
        array = _ARRAY.fullmatch(kind)
        if array:
            return [self._value(array[1], wild=wild) for _ in range(int(array[2]))]
        if '/' in kind:
            package, name = kind.split('/')
            return self.message(f'{package}/msg/{name}', wild=wild)
        return self._basic_value(kind, wild=wild)

    def _basic_value(self, kind: str, *, wild: bool) -> Any:  # noqa: ANN401
        chance = self._chance
        integer = _INTEGER.fullmatch(kind)
        if integer:
            return self._integer(int(integer[2]), is_unsigned=bool(integer[1]), wild=wild)
        if kind in {'double', 'float'}:
            # Some fields of a wild message are right.
            is_odd = wild and chance.random() < 0.7  # noqa: PLR2004
            return chance.choice(_FLOATS) if is_odd else chance.uniform(-1.0, 1.0)
        if kind == 'string':
            return self._string(wild=wild)
        if kind == 'boolean':
            return chance.random() < 0.5  # noqa: PLR2004
        return bytes([chance.randrange(256)])  # of an octet

    def _integer(self, bits: int, *, is_unsigned: bool, wild: bool) -> int:
        if not wild:
            return self._chance.randint(0, 9)

        minimum = 0 if is_unsigned else -(2 ** (bits - 1))
        maximum = 2**bits - 1 if is_unsigned else 2 ** (bits - 1) - 1
        return self._chance.choice((minimum, maximum, 0))

    def _string(self, *, wild: bool) -> str:
        if not wild:
            return ''
        if self._chance.randrange(1000) < _HUGE_SHARE:
            return _HUGE
        return self._chance.choice(_STRINGS)
