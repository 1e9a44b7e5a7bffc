"""Schemas of types, and the types in a schema.

The definitions of the types that rosidl makes of services and actions, such as
`std_srvs/srv/SetBool_Event`, are IDL. In the text of a `.msg` file they would be types of another
name: `std_srvs/msg/SetBool_Event`.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import TypesysError, get_types_from_idl, get_types_from_msg

from barc_sim.bags import bounds
from barc_sim.bags.messages import CDR, IDL, ROS2IDL, ROS2MSG
from barc_sim.interfaces.definitions import DELIMITER, definition, installed

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from barc_sim.bags.messages import Topic

    Fields = Sequence[tuple[str, Any]]

_SECTION = re.compile(r'^---[ \t]*$', re.MULTILINE)
#: The names in IDL of types whose name in a `.msg` file is another one.
_IDL_NAMES = {
    'bool': 'boolean',
    'byte': 'octet',
    'char': 'uint8',
    'float32': 'float',
    'float64': 'double',
}
#: A message without fields has a byte in CDR.
_NO_FIELDS = [('structure_needs_at_least_one_member', (Nodetype.BASE, ('uint8', 0)))]


def schema(name: str) -> tuple[str, str]:
    """Return the definition of a type with all types that it uses, and its encoding.

    Parameters
    ----------
    name
        The type's name, such as `std_msgs/msg/Header`.

    Raises
    ------
    LookupError
        A type is not installed.
    """
    _, _, base = name.rpartition('/')
    is_part = '_' in base and name not in installed()
    if is_part:
        return part_definition(name), ROS2IDL
    return definition(name), ROS2MSG


def part_definition(name: str) -> str:
    """Return the `ros2idl` schema of a part of a service or an action, with all that it uses.

    Parameters
    ----------
    name
        The part's name, such as `std_srvs/srv/SetBool_Event`.

    Raises
    ------
    LookupError
        The service or action, or a type that it uses, is not installed.
    """
    package, _, rest = name.partition('/')
    kind, _, base = rest.partition('/')
    whole, _, _ = base.partition('_')
    path = installed().get(f'{package}/{kind}/{whole}')
    if not path or kind not in _PARTS_OF:
        raise LookupError(f'the definition of {name!r} is not installed')

    text = path.read_text(encoding='utf-8')
    sections = [section.strip() for section in _SECTION.split(text)]
    try:
        parts = _PARTS_OF[kind](f'{package}/{whole}_', *sections)
        types = _types(f'{package}/msg/{base}', parts)
    except (TypeError, TypesysError) as error:
        raise LookupError(f'the definition of {name!r} cannot be read: {error}') from None

    # In IDL a part is of the package's module `srv` or `action`, and not `msg`.
    prefix = f'{package}/msg/{whole}_'
    renamed = {
        type_name: type_name.replace('/msg/', f'/{kind}/')
        for type_name in types
        if type_name.startswith(prefix)
    }
    return '\n'.join(_idl(type_name, fields, renamed) for type_name, fields in types.items())


def _types(name: str, parts: dict[str, str]) -> dict[str, Fields]:
    """Return the fields of a part, and of each type that it uses, by the type's name."""
    types: dict[str, Fields] = {}
    waiting = [name]
    while waiting:
        next_name = waiting.pop()
        if next_name in types:
            continue
        short = next_name.replace('/msg/', '/')
        text = parts[short] if short in parts else definition(next_name)
        for type_name, (_, fields) in get_types_from_msg(text, next_name).items():
            types[type_name] = fields
        waiting += _used_types(types[next_name])
    return types


def _service(prefix: str, request: str, response: str) -> dict[str, str]:
    """Return the definition of each part of a service, as in a `.msg` file."""
    return {
        f'{prefix}Request': request,
        f'{prefix}Response': response,
        f'{prefix}Event': f'service_msgs/ServiceEventInfo info\n{prefix}Request[<=1] request\n'
        f'{prefix}Response[<=1] response',
    }


def _action(prefix: str, goal: str, result: str, feedback: str) -> dict[str, str]:
    """Return the definition of each part of an action, as in a `.msg` file."""
    identity = 'unique_identifier_msgs/UUID goal_id'
    return {
        f'{prefix}Goal': goal,
        f'{prefix}Result': result,
        f'{prefix}Feedback': feedback,
        f'{prefix}FeedbackMessage': f'{identity}\n{prefix}Feedback feedback',
        **_service(
            f'{prefix}SendGoal_',
            request=f'{identity}\n{prefix}Goal goal',
            response='bool accepted\nbuiltin_interfaces/Time stamp',
        ),
        **_service(
            f'{prefix}GetResult_',
            request=identity,
            response=f'int8 status\n{prefix}Result result',
        ),
    }


_PARTS_OF: dict[str, Callable[..., dict[str, str]]] = {'srv': _service, 'action': _action}


def _used_types(fields: Fields) -> Iterator[str]:
    """Yield the names of the types that fields have, without numbers and texts."""
    for _, (node, described) in fields:
        element = (node, described)
        if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            element, _ = described
        element_node, name = element
        if element_node == Nodetype.NAME and not name.endswith('/wstring'):
            yield name


def _idl(name: str, fields: Fields, renamed: dict[str, str]) -> str:
    """Return a type's part of the schema; `renamed` has the names of parts."""
    full = renamed.get(name, name)
    package, kind, base = full.split('/')
    definitions = []
    members = []
    for field, (node, described) in fields:
        if node == Nodetype.ARRAY:
            element, size = described
            array = f'{base}__{field}'
            definitions.append(f'typedef {_type(element, renamed)} {array}[{size}];')
            members.append(f'{array} {field};')
        elif node == Nodetype.SEQUENCE:
            element, bound = described
            limit = f', {bound}' if bound else ''
            members.append(f'sequence<{_type(element, renamed)}{limit}> {field};')
        else:
            members.append(f'{_type((node, described), renamed)} {field};')
    body = '\n  '.join(members or ['uint8 structure_needs_at_least_one_member;'])
    text = '\n'.join([*definitions, f'struct {base} {{\n  {body}\n}};'])
    return f'{IDL}{full}\nmodule {package} {{ module {kind} {{\n{text}\n}}; }};\n'


def _type(element: tuple[Nodetype, Any], renamed: dict[str, str]) -> str:
    """Return the IDL of a type that is neither an array nor a sequence."""
    node, described = element
    if node == Nodetype.NAME and described.endswith('/wstring'):
        return 'wstring'
    if node == Nodetype.NAME:
        return str(renamed.get(described, described)).replace('/', '::')
    kind, bound = described
    idl_name = _IDL_NAMES.get(kind, kind)
    return f'{idl_name}<{bound}>' if bound else idl_name


def types_of(topic: Topic) -> dict[str, Any]:
    """Return the types in a topic's definition.

    Returns
    -------
    dict
        Constants and fields of each type as rosbags has them, by name.

    Raises
    ------
    ValueError
        The messages or the definition have another encoding than ROS's, or the definition exceeds
        a bound.
    LookupError
        There is no definition, and the type is not installed.
    """
    text, encoding = _definition(topic)
    if len(text) > bounds.MAX_SCHEMA:
        raise ValueError(f'its definition has {len(text)} characters')

    types: dict[str, Any] = {}
    if encoding == ROS2IDL or text.startswith(IDL):
        for part in text.split(f'{DELIMITER}\n')[1:]:
            _, _, idl = part.partition('\n')
            types |= get_types_from_idl(idl)
    else:
        types |= get_types_from_msg(text, topic.type)

    elements = sum(_unrolled_elements(fields) for _, fields in types.values())
    if elements > bounds.MAX_ARRAY:
        raise ValueError(f'its arrays have {elements} elements')
    return {name: (constants, fields or _NO_FIELDS) for name, (constants, fields) in types.items()}


def _unrolled_elements(fields: Fields) -> int:
    """Return for how many elements of arrays rosbags writes code: those of texts and messages."""
    elements = 0
    for _, (node, described) in fields:
        if node == Nodetype.ARRAY:
            (element_node, element), size = described
            if element_node == Nodetype.NAME or element[0] == 'string':
                elements += size
    return elements


def _definition(topic: Topic) -> tuple[str, str]:
    """Return a topic's definition, by default the installed one, and its encoding."""
    if topic.message_encoding != CDR:
        raise ValueError(f'its messages are {topic.message_encoding!r}, and not {CDR!r}')
    if not topic.type:
        raise ValueError('it has no schema')

    if topic.definition:
        if topic.schema_encoding not in (ROS2MSG, ROS2IDL):
            raise ValueError(
                f'its schema is {topic.schema_encoding!r}, and not {ROS2MSG!r} or {ROS2IDL!r}'
            )
        # Bytes that are not UTF-8 cannot be printed.
        data = topic.definition.encode(errors='surrogateescape')
        return data.decode(errors='replace'), topic.schema_encoding

    try:
        return schema(topic.type)
    except LookupError:
        if topic.schema_encoding == ROS2MSG:  # so rosbag2 writes a type without fields
            return '', ROS2MSG
        raise
