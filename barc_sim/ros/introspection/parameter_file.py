"""Parameter files, as rcl reads them with `--params-file` and `ros2 param dump` writes them."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import yaml

from barc_sim.cli.files import read_regular
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

_KEY = 'ros__parameters'
_EXPECTED = f'expected nodes with {_KEY}, as `barc param dump` writes them'


def text(node: str, values: Mapping[str, Any]) -> str:
    """Return the text of a node's file; a dot in a name opens a level.

    Examples
    --------
    >>> print(text('/controller', {'gains.k_p': 40.0, 'speed_reference': 8.0}), end='')
    /controller:
      ros__parameters:
        gains:
          k_p: 40.0
        speed_reference: 8.0
    """
    nested: dict[str, Any] = {}
    for name, value in sorted(values.items()):
        *groups, last = name.split('.')
        level = nested
        for group in groups:
            level = level.setdefault(group, {})
        level[last] = value
    return yaml.safe_dump({node: {_KEY: nested}}, default_flow_style=False, allow_unicode=True)


def read(path: Path, node: str, *, wildcards: bool = True) -> dict[str, Any]:
    """Return the parameters in the file for the node of this full name.

    They have their YAML types, as in rcl; `rclpy.parameter_client` reads 1.0e-7 as a string and
    '7' as a number. Later entries override earlier ones, as in rcl.

    Parameters
    ----------
    path
        The file.
    node
        Such as `/car2/controller`.
    wildcards
        Whether entries with wildcards, such as `/**`, count, too.

    Raises
    ------
    UserError
        where the file cannot be read, or has no parameters for the node.

    Examples
    --------
    >>> from pathlib import Path
    >>> file = Path('car.yaml')
    >>> _ = file.write_text(text('/**', {'speed_reference': 8.0}))
    >>> read(file, '/car2/controller')
    {'speed_reference': 8.0}
    """
    try:
        content = yaml.safe_load(read_regular(path, 1 << 24).decode())
    except OSError as error:
        raise UserError(f'{str(path)!r} cannot be read: {error.strerror}') from None
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise UserError(f'{str(path)!r} is not YAML in line {line}: {error.problem}') from None
    except (UnicodeDecodeError, yaml.YAMLError):
        raise UserError(f'{str(path)!r} is not a text of YAML: {_EXPECTED}') from None
    if not isinstance(content, dict):
        raise UserError(f'{str(path)!r} is not a file of parameters: {_EXPECTED}')
    entries = list(_entries(content, ''))
    if not entries:
        raise UserError(f'{str(path)!r} has no parameters: {_EXPECTED}')
    values: dict[str, Any] = {}
    found = False
    for key, level in entries:
        if ('*' not in key or wildcards) and _matches(key, node):
            values |= dict(_flat(level, path))
            found = True
    if not found:
        known = ', '.join(key for key, _ in entries)
        raise UserError(f'{str(path)!r} has no parameters for {node}: it has some for {known}')
    return values


def _entries(level: Mapping[Any, Any], node: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield each node in a file with its parameters."""
    for key, value in level.items():
        if isinstance(value, dict):
            if key == _KEY:
                yield node, value
            else:
                yield from _entries(value, f'{node}/{str(key).strip("/")}')


def _matches(key: str, node: str) -> bool:
    """Return whether `key` matches the node: `*` stands for one part of a name, `**` for any."""
    parts = re.split(r'(/\*\*|\*)', key)
    pattern = {'/**': '(/[^/]+)*', '*': '[^/]+'}
    return bool(re.fullmatch(''.join(pattern.get(part, re.escape(part)) for part in parts), node))


def _flat(level: Mapping[Any, Any], path: Path, prefix: str = '') -> Iterator[tuple[str, Any]]:
    for key, value in level.items():
        name = f'{prefix}{key}'
        if isinstance(value, dict):
            yield from _flat(value, path, f'{name}.')
        elif value is None:
            raise UserError(f'parameter {name} in {str(path)!r} has no value: give it one')
        else:
            yield name, value
