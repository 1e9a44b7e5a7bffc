"""Files of parameters: written as `ros2 param dump` does, read as rcl does."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
import yaml

from barc_sim.errors import UserError
from barc_sim.ros.parameter_client import file_text, read_file

if TYPE_CHECKING:
    from pathlib import Path

VALUES = {
    'kd': 1e-7,
    'label': '7',
    'on': 'off',
    'whole': 3,
    'flag': True,
    'list': [1.0, 2.0],
    'motor.delay': 0.02,
    'motor.lag': 0.1,
}


def test_what_was_written_is_read_to_the_last_bit_and_with_its_type(tmp_path: Path) -> None:
    path = tmp_path / 'p.yaml'
    path.write_text(file_text('/car/controller', VALUES))
    again = read_file(path, '/car/controller')
    assert again == VALUES
    assert {name: type(value) for name, value in again.items()} == {
        name: type(value) for name, value in VALUES.items()
    }


def test_file_is_that_of_ros2_param_dump() -> None:
    assert file_text('/a', {'b.c': 1.0, 'a': 'x'}) == (
        '/a:\n  ros__parameters:\n    a: x\n    b:\n      c: 1.0\n'
    )


@pytest.mark.parametrize(
    ('key', 'node', 'meant'),
    [
        ('/**', '/car/controller', True),
        ('/car/controller', '/car/controller', True),
        ('controller', '/controller', True),
        ('/controller', '/car/controller', False),
        ('/control', '/controller', False),
    ],
)
def test_entries_of_the_node_and_of_all_nodes_count(
    tmp_path: Path, key: str, node: str, meant: bool
) -> None:
    path = tmp_path / 'p.yaml'
    path.write_text(yaml.safe_dump({key: {'ros__parameters': {'a': 1}}}))
    if meant:
        assert read_file(path, node) == {'a': 1}
    else:
        with pytest.raises(UserError, match=f'has no parameters for {node}: expected nodes'):
            read_file(path, node)


def test_later_entry_goes_before_an_earlier_one(tmp_path: Path) -> None:
    path = tmp_path / 'p.yaml'
    path.write_text('/**: {ros__parameters: {a: 1, b: 1}}\n/n: {ros__parameters: {a: 2}}\n')
    assert read_file(path, '/n') == {'a': 2, 'b': 1}


@pytest.mark.parametrize(
    ('content', 'sentence'),
    [
        ('a: b: c', 'is not a text of YAML: .* line 1, column 5'),
        ('a: &a [1]\nb: *a\n', 'is not a text of YAML: .* an alias'),
        ('[' * 20_000, 'is not a text of YAML: .* too many values within values'),
        ('- 1', 'has no parameters for /n: expected nodes with ros__parameters'),
        ('', 'has no parameters for /n'),
        ('n: 1', 'has no parameters for /n'),
        ('n: {ros__parameters: 1}', 'has no parameters for /n'),
        ('/n: {ros__parameters: {a: }}', "parameter a in '.*' has no value: give it one"),
    ],
)
def test_what_is_no_such_file_is_one_sentence(tmp_path: Path, content: str, sentence: str) -> None:
    path = tmp_path / 'p.yaml'
    path.write_text(content)
    with pytest.raises(UserError, match=sentence):
        read_file(path, '/n')


def test_binary_and_missing_files_are_named(tmp_path: Path) -> None:
    path = tmp_path / 'p.yaml'
    with pytest.raises(UserError, match='cannot be read: No such file'):
        read_file(path, '/n')
    path.write_bytes(b'\xff\xfe\x00')
    with pytest.raises(UserError, match='is not a text of YAML'):
        read_file(path, '/n')
