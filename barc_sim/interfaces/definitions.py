"""The definitions of messages, services and actions, with or without ROS.

They come from installed packages of messages, or else from barc_sim.
"""

from __future__ import annotations

import os
import re
from functools import cache
from importlib.machinery import PathFinder
from pathlib import Path
from typing import TYPE_CHECKING, Any

from barc_sim.cli.parser import did_you_mean
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from rosbags.typesys.store import Typestore

_SIGNED = {'int8', 'int16', 'int32', 'int64'}
_UNSIGNED = {'uint8', 'uint16', 'uint32', 'uint64'}
_OTHER_PRIMITIVES = {'bool', 'byte', 'char', 'float32', 'float64', 'string', 'wstring'}
PRIMITIVES = _SIGNED | _UNSIGNED | _OTHER_PRIMITIVES
_FIELD_TYPE = re.compile(r'(?:^|\n)\s*([a-zA-Z0-9_/]+)(?:\[[^\]]*\])?\s+')
# Definitions, with their comments, as `<package>/<name>.msg`: what a run without ROS records.
_SHIPPED = Path(__file__).with_name('msg')
# In a checkout our own definitions are beside the package; in a wheel, with the others.
_CHECKOUT = Path(__file__).parents[2] / 'barc_interfaces' / 'msg'
_PACKAGE = 'barc_interfaces'
_FIELD = re.compile(r'\s*([a-zA-Z]\w*(?:/\w+)?)(?:<=\d+)?(?:\[[^\]]*\])?\s+\w+\b(?!\s*=)')
_COMMENT = re.compile(r'\s*#.*')
DELIMITER = '=' * 80  #: between a definition and those that it uses
#: The field that rosidl adds to a type without fields, as DDS allows none.
_PLACEHOLDER = 'uint8 structure_needs_at_least_one_member'


def _with_field(text: str) -> str:
    """Return a message definition; one without fields gets the field that rosidl adds."""
    if any(_FIELD.match(_COMMENT.sub('', line)) for line in text.splitlines()):
        return text
    return f'{text.rstrip()}\n{_PLACEHOLDER}\n'.lstrip('\n')


@cache
def definition(type_name: str) -> str:
    """Return the `ros2msg` schema of a type: its definition and those of all types that it uses.

    The layout is rosbag2's: the type's own text first; then, depth first and by name, each
    dependency once, under a line of 80 `=` and its name as `MSG: std_msgs/Header`. A type without
    fields has the field that it has in CDR; other readers need it.

    Raises
    ------
    LookupError
        A type is not installed.
    """
    paths = installed()
    expanded = {type_name}

    def expand(name: str) -> str:
        package = name.partition('/')[0]
        full = name if name.count('/') > 1 else name.replace('/', '/msg/')
        if full not in paths:
            raise LookupError(f'the definition of {name!r} is not installed')

        text = _with_field(paths[full].read_text(encoding='utf-8'))
        types = set(_FIELD_TYPE.findall(text)) - PRIMITIVES
        dependencies = [kind if '/' in kind else f'{package}/{kind}' for kind in types]

        for dependency in sorted(dependencies):
            if dependency not in expanded:
                expanded.add(dependency)
                text += f'\n{DELIMITER}\nMSG: {dependency}\n{expand(dependency)}'
        return text

    return expand(type_name)


def shipped() -> Iterator[tuple[str, Path]]:
    """Yield the name of each message type that barc_sim ships, and the file that defines it."""
    for path in (*_SHIPPED.glob('*/*.msg'), *_CHECKOUT.glob('*.msg')):
        package = path.parent.name if path.parent.parent == _SHIPPED else 'barc_interfaces'
        yield f'{package}/msg/{path.stem}', path


def installed() -> dict[str, Path]:
    """Return the file of each message, service and action: the installed, or else barc_sim's."""
    return _files(os.environ.get('AMENT_PREFIX_PATH', ''))


@cache
def _files(prefixes: str) -> dict[str, Path]:
    roots = [Path(prefix) / 'share' for prefix in prefixes.split(os.pathsep) if prefix]
    # ROS from wheels does not set AMENT_PREFIX_PATH. The messages of `ros/local` have no file.
    spec = PathFinder.find_spec(_PACKAGE)
    if spec:
        folders = [folder / 'share' for folder in Path(spec.origin or '').parents]
        roots += [folder for folder in folders if (folder / _PACKAGE).is_dir()]

    paths = dict(shipped())
    for root in reversed(roots):
        for kind in ('msg', 'srv', 'action'):
            for path in root.glob(f'*/{kind}/*.{kind}'):
                paths[f'{path.parents[1].name}/{kind}/{path.stem}'] = path

    return dict(sorted(paths.items()))


def find_type(name: str) -> str:
    """Return the full name of a type.

    Parameters
    ----------
    name
        The type, as `ECU`, `barc_interfaces/ECU` or in full.

    Raises
    ------
    UserError
        There is no type of this name, or there are several.
    """
    types = installed()
    if name in types:
        return name

    matches = [full for full in types if name in _short_names(full)]
    matches_in_package = [full for full in matches if full.startswith(f'{_PACKAGE}/')]
    candidates = matches_in_package or matches
    if len(candidates) == 1:
        return candidates[0]
    if matches:
        raise UserError(f'{name!r} is the name of several types: name one of {", ".join(matches)}')
    raise UserError(f'there is no message, service or action {name!r}{_hint(name, types)}')


def _hint(name: str, types: Iterable[str]) -> str:
    """Return the end of the sentence: a similar name, or all types of ours."""
    names = set(types)
    for full in types:
        names.update(_short_names(full))
    for candidate in names:
        if candidate.lower() == name.lower():
            return f': did you mean {candidate}?'

    suggestion = did_you_mean(name, names)
    if suggestion:
        return suggestion
    in_package = [_short_names(full)[0] for full in types if full.startswith(f'{_PACKAGE}/')]
    return f': {_PACKAGE} has {", ".join(in_package)}'


def _short_names(full: str) -> tuple[str, str]:
    package, _, base = full.split('/')
    return base, f'{package}/{base}'


def definition_lines(name: str, depth: int = 0) -> Iterator[str]:
    """Yield the lines of the definition of `name`, with those of its fields' types indented.

    Only the comments of the type itself, at `depth` 0, are kept.
    """
    paths = installed()
    for line in paths[name].read_text(encoding='utf-8').splitlines():
        text = _COMMENT.sub('', line) if depth else line
        if text or not depth:
            yield ('\t' * depth + text).rstrip()

        field = _FIELD.match(_COMMENT.sub('', line))
        if field and field[1] not in PRIMITIVES:
            package, _, base = field[1].rpartition('/')
            nested = f'{package or name.partition("/")[0]}/msg/{base}'
            if nested in paths:
                yield from definition_lines(nested, depth + 1)


@cache
def store() -> Typestore:
    """Return the types of Jazzy's common interfaces and of barc_interfaces."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415 (100 ms)

    typestore = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for name, path in shipped():
        if name not in typestore.fielddefs:
            types |= get_types_from_msg(path.read_text(encoding='utf-8'), name)

    typestore.register(types)
    return typestore


def definition_without_ros(type_name: str) -> str:
    """Return what `definition` does; where no package is installed, of a common interface, too."""
    try:
        return definition(type_name)
    except LookupError:
        text, _ = store().generate_msgdef(type_name, ros_version=2)
        return _with_field(text)
