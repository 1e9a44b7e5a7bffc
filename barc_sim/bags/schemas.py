"""The definitions of message and service types: as a bag has them, and as one reads them.

They come from the files installed with their packages or with barc_sim, or from type descriptions.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
from contextlib import suppress
from functools import cache
from importlib.machinery import PathFinder
from pathlib import Path
from typing import TYPE_CHECKING, Any

from barc_sim.cli.parser import did_you_mean
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

_NUMBERS = {f'{sign}int{bits}' for sign in ('', 'u') for bits in (8, 16, 32, 64)}
PRIMITIVES = {'bool', 'byte', 'char', 'float32', 'float64', 'string', 'wstring', *_NUMBERS}
_FIELD_TYPE = re.compile(r'(?:^|\n)\s*([a-zA-Z0-9_/]+)(?:\[[^\]]*\])?\s+')
# Definitions, with their comments, as `<package>/<name>.msg`: what a run without ROS records.
_SHIPPED = Path(__file__).with_name('msg')
# In a checkout the lab's own lie beside the package; in a wheel, with the others.
_CHECKOUT = Path(__file__).parents[2] / 'barc_interfaces' / 'msg'
_OURS = 'barc_interfaces'
_FIELD = re.compile(r'\s*([a-zA-Z]\w*(?:/\w+)?)(?:<=\d+)?(?:\[[^\]]*\])?\s+\w+')
_COMMENT = re.compile(r'\s*#.*')
_DELIMITER = '=' * 80
_NESTED = 1
# type_description_interfaces/msg/FieldType: the plain types below 48; in steps of 48, arrays,
# bounded and unbounded sequences of them.
_PLAIN = {
    2: 'int8',
    3: 'uint8',
    4: 'int16',
    5: 'uint16',
    6: 'int32',
    7: 'uint32',
    8: 'int64',
    9: 'uint64',
    10: 'float32',
    11: 'float64',
    13: 'char',
    15: 'bool',
    16: 'byte',
    17: 'string',
    18: 'wstring',
    21: 'string<={string_capacity}',
    22: 'wstring<={string_capacity}',
}
_MANY = ('', '[{capacity}]', '[<={capacity}]', '[]')


@cache
def definition(type_name: str) -> str:
    """Return the `ros2msg` schema of a type: its definition and those of all that it refers to.

    A message's definition is the text of its `.msg` file; a type of a service or an action has no
    such file, so that its definition is made from its type description. The layout is rosbag2's:
    the type's own text first; then, depth first and by name, each dependency once, under a line of
    80 `=` and its name as `MSG: std_msgs/Header`. LookupError: one of them is not installed.
    """
    package, kind, base = _parts(type_name)
    if kind != 'msg':
        return _described(package, kind, base)

    def described(name: str) -> tuple[str, set[str]]:
        text = _text(name)
        return text, _dependencies(text, name.partition('/')[0])

    return _with_dependencies(type_name, described)


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
    return definition_of(
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
        if package.isidentifier():  # what stands in for ROS has no share folder
            spec = PathFinder.find_spec(package) or importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        raise LookupError(f'the package {package!r} is not installed')
    for folder in Path(spec.origin).parents:
        share = folder / 'share' / package
        if share.is_dir():
            return share
    raise LookupError(f'no share/{package} is installed above {spec.origin!r}')


def definition_of(name: str, descriptions: Iterable[Mapping[str, Any]]) -> str:
    """Return the `ros2msg` schema of a type, from its description and those that it refers to.

    They are JSON of type_description_interfaces/msg/IndividualTypeDescription.
    """
    by_name = {description['type_name']: description for description in descriptions}

    def described(name: str) -> tuple[str, set[str]]:
        if name not in by_name:
            raise LookupError(f'no description of {name!r}')
        fields = by_name[name]['fields']
        text = ''.join(f'{_type(field["type"])} {field["name"]}\n' for field in fields)
        return text, {field['type']['nested_type_name'] for field in fields} - {''}

    return _with_dependencies(name, described)


def _with_dependencies(name: str, described: Callable[[str], tuple[str, set[str]]]) -> str:
    """Return a type's text; then, depth first and by name, that of each dependency once.

    `described` returns the text of a type alone, and the types that it refers to.
    """
    seen = {name}

    def expand(name: str) -> str:
        text, dependencies = described(name)
        for dependency in sorted(dependencies):
            if dependency not in seen:
                seen.add(dependency)
                text += f'\n{_DELIMITER}\nMSG: {_short(dependency)}\n{expand(dependency)}'
        return text

    return expand(name)


def _type(field_type: Mapping[str, Any]) -> str:
    many, plain = divmod(field_type['type_id'], 48)
    if plain == _NESTED:
        base = _short(field_type['nested_type_name'])
    elif plain in _PLAIN:
        base = _PLAIN[plain].format_map(field_type)
    else:
        raise LookupError(f'no ros2msg name for the field type {field_type["type_id"]}')
    return base + _MANY[many].format_map(field_type)


def _short(name: str) -> str:
    """Return `std_msgs/Header` for `std_msgs/msg/Header`; a service's or action's name is kept."""
    return name.replace('/msg/', '/')


def installed() -> dict[str, Path]:
    """Return the file of each message and service type, barc_sim's own and the installed ones."""
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    roots = [Path(prefix) / 'share' for prefix in prefixes if prefix]
    with suppress(LookupError):
        roots.append(share(_OURS).parent)
    found = dict(shipped())
    for root in roots:
        for kind in ('msg', 'srv'):
            for path in root.glob(f'*/{kind}/*.{kind}'):
                found[f'{path.parents[1].name}/{kind}/{path.stem}'] = path
    return dict(sorted(found.items()))


def find_type(name: str) -> str:
    """Return the full name of a type: of `ECU`, `barc_interfaces/ECU` or itself."""
    known = installed()
    if name in known:
        return name
    found = [full for full in known if name in _short_names(full)]
    ours = [full for full in found if full.startswith(f'{_OURS}/')]
    if len(ours or found) == 1:
        return (ours or found)[0]
    if found:
        raise UserError(f'{name!r} is the name of several types: name one of {", ".join(found)}')
    names = {short for full in known for short in (*_short_names(full), full)}
    same = [each for each in names if each.lower() == name.lower()]
    ends = f': did you mean {same[0]}?' if same else did_you_mean(name, names)
    own = ', '.join(_short_names(full)[0] for full in known if full.startswith(f'{_OURS}/'))
    raise UserError(f'there is no message or service {name!r}{ends or f": {_OURS} has {own}"}')


def _short_names(full: str) -> tuple[str, str]:
    package, _, base = full.split('/')
    return base, f'{package}/{base}'


def definition_lines(name: str) -> Iterator[str]:
    """Yield the lines of the definition of `name`, with those of its fields' types indented.

    Comments are those of the type itself.
    """
    yield from _lines_of(installed(), name, 0)


def _lines_of(known: dict[str, Path], name: str, depth: int) -> Iterator[str]:
    for line in known[name].read_text(encoding='utf-8').splitlines():
        text = _COMMENT.sub('', line) if depth else line
        if text or not depth:
            yield ('\t' * depth + text).rstrip()
        field = _FIELD.match(_COMMENT.sub('', line))
        if field and field[1] not in PRIMITIVES:
            package, _, base = field[1].rpartition('/')
            nested = f'{package or name.partition("/")[0]}/msg/{base}'
            if nested in known:
                yield from _lines_of(known, nested, depth + 1)
