"""The definition of a message type, from the files installed with its package or with barc_sim."""

from __future__ import annotations

import importlib.util
import json
import re
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.bags import type_descriptions

if TYPE_CHECKING:
    from collections.abc import Iterator

_NUMBERS = {f'{sign}int{bits}' for sign in ('', 'u') for bits in (8, 16, 32, 64)}
PRIMITIVES = {'bool', 'byte', 'char', 'float32', 'float64', 'string', 'wstring', *_NUMBERS}
_FIELD_TYPE = re.compile(r'(?:^|\n)\s*([a-zA-Z0-9_/]+)(?:\[[^\]]*\])?\s+')
# The definitions that runs without ROS need, as `<package>/<name>.msg`.
_SHIPPED = Path(__file__).with_name('msg')
# In a checkout the lab's own lie beside the package; in a wheel, with the others.
_CHECKOUT = Path(__file__).parents[2] / 'barc_interfaces' / 'msg'


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

    Examples
    --------
    >>> print(definition('std_msgs/msg/Header').splitlines()[-1])
    uint32 nanosec
    """
    package, kind, base = _parts(type_name)
    if kind != 'msg':
        return _described(package, kind, base)

    def described(name: str) -> tuple[str, set[str]]:
        text = _text(name)
        return text, _dependencies(text, name.partition('/')[0])

    return type_descriptions.with_dependencies(type_name, described)


def shipped() -> Iterator[tuple[str, Path]]:
    """Yield the name of each message type that barc_sim brings, and the file that defines it."""
    for path in (*_SHIPPED.glob('*/*.msg'), *_CHECKOUT.glob('*.msg')):
        package = path.parent.name if path.parent.parent == _SHIPPED else 'barc_interfaces'
        yield f'{package}/msg/{path.stem}', path


def _text(name: str) -> str:
    """Return the text of a message's definition: the installed one, else that of barc_sim."""
    package, _, base = name.replace('/msg/', '/').partition('/')
    brought = dict(shipped()).get(f'{package}/msg/{base}')
    try:
        path = share(package) / 'msg' / f'{base}.msg'
    except LookupError:
        if brought is None:
            raise
        path = brought
    if path.is_file():
        return path.read_text(encoding='utf-8')
    raise LookupError(f'{name!r} has no definition at {str(path)!r}')


def _parts(type_name: str) -> tuple[str, str, str]:
    package, _, rest = type_name.partition('/')
    kind, _, base = rest.partition('/')
    if not (package.isidentifier() and kind.isidentifier() and base.isidentifier()):
        raise LookupError(f'{type_name!r} is not the name of a type')
    return package, kind, base


def _described(package: str, kind: str, base: str) -> str:
    """Return the schema of a type such as `std_srvs/srv/SetBool_Event`, from `SetBool.json`."""
    file = share(package) / kind / f'{base.partition("_")[0]}.json'
    if not file.is_file():
        raise LookupError(f'{package}/{kind}/{base} has no description at {str(file)!r}')
    content = json.loads(file.read_text(encoding='utf-8'))['type_description_msg']
    return type_descriptions.definition(
        f'{package}/{kind}/{base}',
        [content['type_description'], *content['referenced_type_descriptions']],
    )


def _dependencies(text: str, package: str) -> set[str]:
    """Return the message types among a definition's fields, as in `std_msgs/Header`."""
    names = set(_FIELD_TYPE.findall(text)) - PRIMITIVES
    return {name if '/' in name else f'{package}/{name}' for name in names}


@cache
def share(package: str) -> Path:
    """Return a package's share folder: `share/<package>` in a folder above its Python module.

    This works without AMENT_PREFIX_PATH, which ROS from wheels does not set: in a virtual
    environment, in /opt/ros and in a colcon workspace.
    """
    spec = None
    with suppress(ImportError):
        spec = importlib.util.find_spec(package) if package.isidentifier() else None
    if spec is None or spec.origin is None:
        raise LookupError(f'the package {package!r} is not installed')
    for folder in Path(spec.origin).parents:
        share = folder / 'share' / package
        if share.is_dir():
            return share
    raise LookupError(f'no share/{package} is installed above {spec.origin!r}')
