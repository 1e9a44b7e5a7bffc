"""Replies of a submission's process, as a stranger writes them.

Each is taken as the reply to every request. Results that pass have any size that a float can have:
with such results a lab is judged, and each score stays a share.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from _bytes import TEXTS, damage

from barc_sim.errors import UserError
from barc_sim.lab.confined.process import JudgedCode
from barc_sim.lab.confined.replies import RESULTS, ListOf, Nothing, Number, Row, max_size, parsed
from barc_sim.lab.files import UserCodeError
from barc_sim.lab.labs.hills import HILLS
from barc_sim.lab.labs.identify import IDENTIFY
from barc_sim.lab.labs.lane import LANE
from barc_sim.lab.labs.raceline import RACELINE

if TYPE_CHECKING:
    from collections.abc import Callable
    from random import Random

    from barc_sim.lab.confined.replies import Shape

clock = time.process_time
_SERIAL = 3
_LABS = (HILLS, LANE, RACELINE, IDENTIFY)
#: The arguments of each request.
_REQUESTS: dict[str, tuple[Any, ...]] = {
    'functions': ('bikeFE', [[0.0] * 11] * 3),
    'steps': ('PID', 0, [[8.0, 7.0, 0.02]] * 3),
    'make': ('PID', 0, 1.0, 1.0, 1.0),
    'lines': ('functions', 'bikeFE', []),
    'relay_commands': ([], 1.0, []),
    'notes': (),
    'name': (),
}
_NUMBERS = (0.0, -0.0, 1.0, -1.0, 5e-324, 1e-300, 1e154, -1e155, 1.7e308, -1.7e308)
_STRANGE: tuple[Any, ...] = (
    float('nan'),
    float('inf'),
    10**400,
    -(10**4000),
    True,
    None,
    '1.0',
    [],
    {},
    [[]],
)


def original() -> None:
    """Do nothing: the replies are made as they are needed."""


def damaged_file(chance: Random) -> tuple[str, str, bytes]:
    """Return the suffix of a file, what is damaged in it, and its content."""
    request = chance.choice([*_REQUESTS])
    result = _value(RESULTS[request](*_REQUESTS[request]), chance)
    match chance.randrange(4):
        case 0:
            return '.json', 'any bytes', damage(_reply(result), chance)
        case 1:
            return '.json', 'a value within', _reply(_with_strange(result, chance))
        case 2:
            return '.json', 'the frame', _with_odd_frame(result, chance)
    return '.json', 'numbers of any size', _reply(result)


def _reply(result: object, serial: object = _SERIAL) -> bytes:
    return json.dumps({'serial': serial, 'result': result}).encode() + b'\n'


def _value(shape: Shape, chance: Random) -> Any:  # noqa: ANN401, PLR0911 (of any shape)
    """Return a value of a shape."""
    if isinstance(shape, Nothing):
        return None
    if isinstance(shape, Number):
        return chance.choice(_NUMBERS) if chance.random() < 0.5 else chance.gauss(0.0, 5.0)  # noqa: PLR2004
    if isinstance(shape, ListOf):
        length = chance.choice((0, 1, 7)) if shape.or_fewer else shape.length
        return [_value(shape.item, chance) for _ in range(length)]
    if isinstance(shape, Row):
        return [_value(item, chance) for item in shape.items]
    if hasattr(shape, 'fields'):
        return {name: _value(field, chance) for name, field in shape.fields.items()}
    if hasattr(shape, 'item'):
        return chance.choice((None, _value(shape.item, chance)))
    return chance.choice(('', 'Ada', 'bike_model.py, line 3', '\ud800', '\x1b[2J', 'ü' * 60))


def _with_strange(value: Any, chance: Random) -> Any:  # noqa: ANN401 (of any shape)
    """Return the value with another one somewhere in it."""
    if isinstance(value, list) and value and chance.random() < 0.8:  # noqa: PLR2004 (mostly)
        at = chance.randrange(len(value))
        return [*value[:at], _with_strange(value[at], chance), *value[at + 1 :]]
    if isinstance(value, dict) and chance.random() < 0.8:  # noqa: PLR2004 (mostly)
        name = chance.choice([*value])
        return value | {name: _with_strange(value[name], chance)}
    if isinstance(value, list) and chance.random() < 0.5:  # noqa: PLR2004 (half)
        return value * chance.choice((0, 2, 100_000))
    return chance.choice((*_STRANGE, *TEXTS))


def _with_odd_frame(result: object, chance: Random) -> bytes:
    forms = (
        b'[' * 200_000,
        b'{"serial": 3, "result": ' + b'[' * 100_000,
        b'{"serial": 3, "result": ' + b'9' * 100_000 + b'}',
        b'{"serial": 3, "error": "' + b'x' * 3_990 + b'"}',
        b'{"serial": 3, "error": "\\ud800"}',
        b'{"serial": 3, "error": {}}',
        _reply(result, chance.choice((2, 4, '3', None, [3], 3.5, True))),
        _reply(result) * 2,
        _reply(result)[:-1],
        b'',
    )
    return chance.choice(forms)


class _ForgedCode(JudgedCode):
    """Code whose results are of the right shape, and of any size."""

    def __init__(self, chance: Random) -> None:
        super().__init__(Path())
        self._chance = chance
        self._constant = chance.random() < 0.3  # noqa: PLR2004 (some)
        self._first: dict[str, Any] = {}

    def has(self, part: str) -> bool:
        return bool(part)

    def call(self, do: str, *arguments: Any) -> Any:  # noqa: ANN401 (of any shape)
        if self._chance.random() < 0.02:  # noqa: PLR2004 (few)
            raise UserCodeError(f'{do} has failed')

        shape = RESULTS[do](*arguments)
        value = _value(shape, self._chance)
        if self._constant and isinstance(value, list) and value:
            first = self._first.setdefault(f'{do} {arguments[:1]}', value[0])
            value = [first] * len(value)
        return shape.checked(value)


def _take(path: Path) -> None:
    """Take a reply as that to each request."""
    first_line = path.read_bytes().partition(b'\n')[0]
    accepted = 0
    for request, arguments in _REQUESTS.items():
        shape = RESULTS[request](*arguments)
        try:
            result, error = parsed(first_line[: max_size(shape)], _SERIAL)
            sentence = error.text if error else None
            json.dumps((shape.checked(result), sentence), ensure_ascii=False).encode()
            accepted += 1
        except ValueError:
            continue
    if not accepted:
        raise UserError('no request has such a reply')


def uses(chance: Random) -> list[Callable[[Path], object]]:
    """Return what to do with a file, one after the other."""
    is_judged = chance.random() < 0.1  # noqa: PLR2004 (some: it lasts)

    def judge(_: Path) -> None:
        lab = chance.choice(_LABS)
        code = _ForgedCode(chance)
        for finding in lab.judge(code):
            assert 0.0 <= finding.score <= 1.0, finding  # noqa: S101
            finding.message.encode()

        code.chosen_gains()
        code.tolerated()

    return [_take, judge] if is_judged else [_take]
