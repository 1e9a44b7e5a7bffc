"""The definition of a message type, from the files installed with its package."""

from __future__ import annotations

import importlib.util
import json
import re
from functools import cache
from pathlib import Path

from barc_sim.bags import type_descriptions

_NUMBERS = {f'{sign}int{bits}' for sign in ('', 'u') for bits in (8, 16, 32, 64)}
_PRIMITIVES = {'bool', 'byte', 'char', 'float32', 'float64', 'string', 'wstring', *_NUMBERS}
_FIELD_TYPE = re.compile(r'(?:^|\n)\s*([a-zA-Z0-9_/]+)(?:\[[^\]]*\])?\s+')
_DELIMITER = '=' * 80


@cache
def definition(type_name: str) -> str:
    """Return the `ros2msg` schema of a type: its definition and those of all that it refers to.

    A message's definition is the text of its `.msg` file; a type of a service or an action has no
    such file, so that its definition is made from its type description. The layout is rosbag2's:
    the type's own text first; then, depth first and by name, each dependency once, under a line of
    80 `=` and its name as `MSG: std_msgs/Header`.

    Parameters
    ----------
    type_name
        As in `std_msgs/msg/Header`.

    Raises
    ------
    LookupError
        No installed package has the definition of the type or of one of its dependencies.
    """
    package, kind, base = _parts(type_name)
    if kind != 'msg':
        return _described(package, kind, base)
    seen: set[str] = set()

    def expand(name: str) -> str:
        package, _, base = name.partition('/')
        text = _share(package).joinpath('msg', base.removeprefix('msg/') + '.msg')
        if not text.is_file():
            raise LookupError(f'{name!r} has no definition at {str(text)!r}')
        parts = [text.read_text(encoding='utf-8')]
        for dependency in sorted(_dependencies(parts[0], package)):
            if dependency not in seen:
                seen.add(dependency)
                parts.append(f'\n{_DELIMITER}\nMSG: {dependency}\n')
                parts.append(expand(dependency))
        return ''.join(parts)

    return expand(type_name)


def _parts(type_name: str) -> tuple[str, str, str]:
    package, _, rest = type_name.partition('/')
    kind, _, base = rest.partition('/')
    if not (package.isidentifier() and kind.isidentifier() and base.isidentifier()):
        raise LookupError(f'{type_name!r} is not the name of a type')
    return package, kind, base


def _described(package: str, kind: str, base: str) -> str:
    """Return the schema of a type such as `std_srvs/srv/SetBool_Event`, from `SetBool.json`."""
    file = _share(package) / kind / f'{base.partition("_")[0]}.json'
    if not file.is_file():
        raise LookupError(f'{package}/{kind}/{base} has no description at {str(file)!r}')
    content = json.loads(file.read_text(encoding='utf-8'))['type_description_msg']
    return type_descriptions.definition(
        f'{package}/{kind}/{base}',
        [content['type_description'], *content['referenced_type_descriptions']],
    )


def _dependencies(text: str, package: str) -> set[str]:
    """Return the message types among a definition's fields, as in `std_msgs/Header`."""
    names = set(_FIELD_TYPE.findall(text)) - _PRIMITIVES
    return {name if '/' in name else f'{package}/{name}' for name in names}


@cache
def _share(package: str) -> Path:
    """Return a package's share folder: `share/<package>` in a folder above its Python module.

    This works without AMENT_PREFIX_PATH, which ROS from wheels does not set: in a virtual
    environment, in /opt/ros and in a colcon workspace.
    """
    spec = importlib.util.find_spec(package) if package.isidentifier() else None
    if spec is None or spec.origin is None:
        raise LookupError(f'the package {package!r} is not installed')
    for folder in Path(spec.origin).parents:
        share = folder / 'share' / package
        if share.is_dir():
            return share
    raise LookupError(f'no share/{package} is installed above {spec.origin!r}')
