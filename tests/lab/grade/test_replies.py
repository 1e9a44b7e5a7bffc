"""Replies as a stranger would write them: each field has its type and its limit."""

from __future__ import annotations

import json
from typing import Any

import pytest

from barc_sim.lab.confined.replies import RESULTS, WrongReply, max_size, parsed

#: The arguments of each request, and a right result.
RIGHT: dict[str, tuple[tuple[Any, ...], Any]] = {
    'functions': (('bikeFE', [[0.0] * 11] * 2), [(1.0, 2.0, 3.0, 4.0)] * 2),
    'steps': (('PID', 0, [[8.0, 7.0, 0.02]]), [1.0]),
    'make': (('PID', 0, 1.0, 1.0, 1.0), None),
    'lines': (('functions', 'bikeFE', []), [('bike_model.py, line 3', 1.0)] * 3),
    'relay_commands': (([], 1.0, []), [(0.02, 1.0, -1.0)] * 3),
    'notes': ((), {'gains': (1.0, 2.0, 3.0, 'controller.py, line 9'), 'tolerated': ['x']}),
    'name': ((), 'Zoë'),
}
#: What no code of barc_sim replies to any request.
STRANGE = (
    [['a', 1.0]] * 100_000,
    [[1.0] * 4] * 100_000,
    10**400,
    [[10**400] * 4] * 2,
    [10**400],
    [[float('nan')] * 4] * 2,
    [float('-inf')],
    [[float('inf'), 0.0, 0.0]],
    [['1.0'] * 4] * 2,
    ['1.0'],
    [[True] * 4] * 2,
    [True],
    [{}, {}],
    {'0': [1.0] * 4, '1': [1.0] * 4},
    {},
    'x' * 10_000,
    [['x' * 10_000, 1.0]],
    [['x', '1.0']],
    {'gains': None, 'tolerated': [], 'score': 100},
    {'gains': None, 'tolerated': ['x'] * 21},
    {'gains': None, 'tolerated': ['x' * 10_000]},
    {'gains': [1.0, 1.0, float('nan'), ''], 'tolerated': []},
    {'gains': [1.0, 1.0, 1.0], 'tolerated': []},
    {'gains': [10**400, 1.0, 1.0, ''], 'tolerated': []},
    [[[[[]]]]],
)


def reply_of(result: object, serial: object = 7) -> bytes:
    return json.dumps({'serial': serial, 'result': result}).encode() + b'\n'


def test_each_request_that_code_can_answer_has_its_shape() -> None:
    assert {*RESULTS} == {'', *RIGHT}


@pytest.mark.parametrize('do', RIGHT)
def test_a_right_reply_is_taken_and_a_strange_one_named(do: str) -> None:
    arguments, right = RIGHT[do]
    shape = RESULTS[do](*arguments)
    line = reply_of(right)
    assert len(line) < max_size(shape) < 5_000_000

    result, error = parsed(line, 7)
    assert (shape.checked(result), error) == (right, None)

    for strange in STRANGE:
        result, _ = parsed(reply_of(strange), 7)
        with pytest.raises(WrongReply, match=r'\w'):
            shape.checked(result)


def test_a_whole_number_becomes_a_float() -> None:
    result, _ = parsed(reply_of([1, -2, 10**400]), 7)
    assert result == [1.0, -2.0, float('inf')]


def test_half_a_pair_becomes_an_escape() -> None:
    result, _ = parsed(reply_of('a\ud800b'), 7)
    assert RESULTS['name']().checked(result) == r'a\ud800b'
    _, error = parsed(b'{"serial": 7, "error": "\\udfff"}', 7)
    assert error
    assert error.text == r'\udfff'


@pytest.mark.parametrize(
    'line',
    [
        *(b'', b'\n', b'\xff', b'null', b'[7]', b'{}', b'{"serial": 7', b'"\\ud800'),
        *(reply_of(None, serial) for serial in (6, '7', [7], None)),
        b'[' * 100_000,
        b'{"serial": 7, "result": ' + b'[' * 100_000,
        b'{"serial": 7, "error": 5}',
        b'{"serial": 7, "error": "x", "kind": "a new one"}',
        b'{"serial": 7, "error": "x", "kind": [1]}',
        b'{"serial": 7, "error": "' + b'x' * 5000 + b'"}',
    ],
)
def test_a_reply_of_another_shape_is_refused(line: bytes) -> None:
    with pytest.raises(ValueError, match=r'\w'):
        parsed(line, 7)
