"""YAML from anyone: loaded within bounds, or a ValueError of one sentence."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import barc_sim
from barc_sim.cli.yaml_files import from_yaml, read_yaml
from barc_sim.errors import UserError

#: Lists that would have 10^9 values.
BOMB = 'a0: &a0 [x]\n' + ''.join(
    f'a{k}: &a{k} [{", ".join([f"*a{k - 1}"] * 10)}]\n' for k in range(1, 10)
)
#: A mapping that merges others, which would have 2^40 keys.
MERGED = 'a0: &a0 {x: 1}\n' + ''.join(
    f'a{k}: &a{k} {{<<: [*a{k - 1}, *a{k - 1}], x{k}: 1}}\n' for k in range(1, 41)
)


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('', None),
        ('a: 1e3', {'a': 1000.0}),
        ('a: [inf, -3, 0x10, "1e3"]', {'a': [float('inf'), -3, 16, '1e3']}),
        ('a: &p 10\nb: *p', {'a': 10, 'b': 10}),
        ('a: &p {x: 1}\nb: {<<: *p, y: 2}', {'a': {'x': 1}, 'b': {'x': 1, 'y': 2}}),
    ],
)
def test_ordinary_yaml_is_loaded(text: str, value: Any) -> None:  # noqa: ANN401
    assert from_yaml(text) == value


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        (BOMB, 'aliases count in full'),
        (MERGED, 'aliases count in full'),
        ('a: &a [*a]', 'an alias refers to a list or mapping that it is in'),
        ('[' * 100_000, 'within one another'),
        ('{a: ' * 5_000, 'within one another'),
        ('\n'.join(f'{" " * k}a:' for k in range(300)), 'within one another'),
        ('x' * 200_001, '200001 characters'),
        ('a: ' + '9' * 5_000, 'a number has 5000 characters'),
        ('a: 0x' + 'f' * 5_000, 'a number has 5002 characters'),
        ('a: 1' + ':1' * 5_000, 'a number has 10001 characters'),
        ('a: "\\ud800"', 'surrogates not allowed'),
        ('a: !!python/object/apply:os.system [ls]', 'is not YAML'),
        ('a: 2020-99-99', 'month must be in'),
        ('? [a]\n: b', 'is not YAML'),
        ('a: \0', 'is not YAML'),
        ('a: [', 'is not YAML'),
    ],
)
def test_yaml_beyond_the_limits_is_refused(text: str, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        from_yaml(text)


def test_a_long_text_is_not_tried_as_a_number() -> None:
    """The patterns of numbers would take hours for it."""
    text = '9' * 180_000 + ' points'
    assert from_yaml(text) == text
    with pytest.raises(ValueError, match='a number has 180000 characters'):
        from_yaml('9' * 180_000)


def test_a_file_is_read_in_the_encodings_of_editors(tmp_path: Path) -> None:
    file = tmp_path / 'points.yaml'
    for encoding in ('utf-8', 'utf-8-sig', 'utf-16', 'cp1252'):
        file.write_bytes('comment: für Zoë'.encode(encoding))
        assert read_yaml(file) == {'comment': 'für Zoë'}


def test_a_file_that_is_too_large_is_named(tmp_path: Path) -> None:
    file = tmp_path / 'points.yaml'
    file.write_bytes(b' ' * 1_000_000)
    with pytest.raises(UserError, match=r"points.yaml' has more than"):
        read_yaml(file)


def test_no_other_module_loads_yaml() -> None:
    package = Path(barc_sim.__file__).parent
    modules = {
        path.name
        for path in package.rglob('*.py')
        if re.search(r'yaml\.\w*load', path.read_text(encoding='utf-8'))
    }
    assert modules == {'yaml_files.py'}
