"""What a page may say, and that nothing else gets through."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from barc_sim.page.protocol import (
    Drive,
    Pause,
    Press,
    RequestError,
    Tune,
    encode,
    parse,
)

MALFORMED = [
    '',
    '{',
    'null',
    '[]',
    '{}',
    '{"type":"fly"}',
    '{"type":["drive"],"linear":0,"angular":0}',
    '{"type":"drive"}',
    '{"type":"drive","linear":1}',
    '{"type":"drive","linear":1.01,"angular":0}',
    '{"type":"drive","linear":0,"angular":-1.01}',
    '{"type":"drive","linear":NaN,"angular":0}',
    '{"type":"drive","linear":1e999,"angular":0}',
    '{"type":"drive","linear":"1","angular":0}',
    '{"type":"drive","linear":true,"angular":0}',
    '{"type":"drive","linear":0,"angular":0,"more":0}',
    '{"type":"tune","name":"mass","value":1}',
    '{"type":"tune","name":["kp"],"value":1}',
    '{"type":"tune","name":"kp","value":1e10}',
    '{"type":"tune","name":"kp","value":' + '9' * 400 + '}',
    '{"type":"tune","name":"kp"}',
    '{"type":"pause","on":1}',
    '{"type":"pause"}',
    '{"type":"reset","hard":true}',
    '[' * 100_000,
    b'{"type":"reset"}',
    '{"type":"drive","linear":0,"angular":0,"brake":-1}',
    '{"type":"drive","linear":0,"angular":0,"brake":2}',
]


@pytest.mark.parametrize(
    ('message', 'request_'),
    [
        ('{"type":"drive","linear":1,"angular":-0.5}', Drive(1.0, -0.5)),
        ('{"type":"drive","linear":0,"angular":0,"brake":1}', Drive(brake=1.0)),
        ('{"type":"tune","name":"kp","value":3}', Tune('kp', 3.0)),
        ('{"type":"tune","name":"motor_delay","value":0.1}', Tune('motor_delay', 0.1)),
        ('{"type":"finish"}', Press('finish')),
        ('{"type":"compare"}', Press('compare')),
        ('{"type":"again"}', Press('again')),
        ('{"type":"tune","name":"speed_reference","value":-2.5}', Tune('speed_reference', -2.5)),
        ('{"type":"reset"}', Press('reset')),
        ('{"type":"pause","on":false}', Pause(on=False)),
    ],
)
def test_requests_are_understood(message: str, request_: object) -> None:
    found = parse(message)
    assert found == request_
    assert type(found) is type(request_)


@pytest.mark.parametrize('message', MALFORMED, ids=lambda message: repr(message)[:40])
def test_what_no_page_sends_is_refused(message: str | bytes) -> None:
    with pytest.raises(RequestError):
        parse(message)


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(['type', 'linear', 'angular', 'name', 'value', 'on']), inner, max_size=4
        )
    ),
    max_leaves=6,
)


@given(_JSON.map(json.dumps) | st.text() | st.binary())
def test_whatever_arrives_is_a_request_within_limits_or_refused(message: str | bytes) -> None:
    try:
        found = parse(message)
    except RequestError:
        return
    if isinstance(found, Drive):
        assert all(-1.0 <= share <= 1.0 for share in found)
    elif isinstance(found, Tune):
        assert math.isfinite(found.value)
    else:
        assert isinstance(found, (Press, Pause))


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_every_drive_within_limits_is_understood(linear: float, angular: float) -> None:
    assert parse(encode('drive', linear=linear, angular=angular)) == Drive(linear, angular)


@pytest.mark.parametrize('value', [math.nan, math.inf])
def test_what_json_cannot_say_is_not_said(value: Any) -> None:  # noqa: ANN401 (several)
    with pytest.raises(ValueError, match='JSON'):
        encode('status', factor=value)
