"""Converts type descriptions, from services or installed packages, to `ros2msg` schemas."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

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


def definition(name: str, descriptions: Iterable[Mapping[str, Any]]) -> str:
    """Return the `ros2msg` schema of a type.

    Parameters
    ----------
    name
        As in `std_srvs/srv/SetBool_Event`.
    descriptions
        The descriptions of the type and of those that it refers to, as JSON of
        type_description_interfaces/msg/IndividualTypeDescription.

    Raises
    ------
    LookupError
        One of the types is missing, or has a field that `ros2msg` cannot express.
    """
    by_name = {description['type_name']: description for description in descriptions}

    def described(name: str) -> tuple[str, set[str]]:
        if name not in by_name:
            raise LookupError(f'no description of {name!r}')
        fields = by_name[name]['fields']
        text = ''.join(f'{_type(field["type"])} {field["name"]}\n' for field in fields)
        return text, {field['type']['nested_type_name'] for field in fields} - {''}

    return with_dependencies(name, described)


def with_dependencies(name: str, described: Callable[[str], tuple[str, set[str]]]) -> str:
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
