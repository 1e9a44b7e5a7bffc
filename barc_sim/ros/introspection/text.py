"""Messages as text, as `ros2 topic echo` prints them: a YAML document, or a line of CSV.

By hand because the wheels of ROS lack `rosidl_runtime_py`; a test compares the two where both are
installed. Works on the generated message classes without importing any.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import yaml

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

#: Elements of a long sequence and characters of a long string that are shown.
TRUNCATE = 128
#: SafeDumper, in C where libyaml is installed.
_Dumper = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)
_ENDLESS = 2**30


class Style(NamedTuple):
    """How long fields are shown."""

    truncate: int | None = TRUNCATE  #: elements and characters to show; None: all
    arrays: bool = True  #: show arrays; else their type and length
    strings: bool = True  #: show strings; else their length


def field_of(message: Any, path: str) -> Any:  # noqa: ANN401 (generated classes)
    """Return the field at `path`, such as `header.stamp.sec`, or `ranges.0` of an array.

    Raises
    ------
    UserError
        where there is none; the message lists the fields that exist.
    """
    value = message
    for name in path.split('.'):
        if _is_message(value) and name in _fields(value):
            value = getattr(value, name)
        elif _is_sequence(value) and name.isdecimal() and int(name) < len(value):
            value = value[int(name)]
        else:
            raise UserError(f'there is no field {path!r}: {name!r} is {_alternatives(value)}')
    return value


def to_yaml(value: Any, style: Style) -> str:  # noqa: ANN401
    """Return a message as a YAML document without `---`; a single field as Python prints it."""
    if not _is_message(value):
        return f'{value}\n'
    return yaml.dump(
        _plain(value, style), Dumper=_Dumper, allow_unicode=True, width=_ENDLESS, sort_keys=False
    )


def to_csv(value: Any, style: Style) -> str:  # noqa: ANN401
    """Return all values of a message, or of a field, in one line, separated by commas.

    An empty string or sequence keeps its column; `ros2` drops it if it is the first.
    """
    return ','.join(_cells(value, style))


def _plain(value: Any, style: Style, described: str = '') -> Any:  # noqa: ANN401
    """Return `value` in YAML's types; `described` is the declared type of its field."""
    if _is_message(value):
        return {
            name: _plain(getattr(value, name), style, kind) for name, kind in _fields(value).items()
        }
    if isinstance(value, bytes):
        return _cut(value.decode('latin-1'), style)
    if isinstance(value, str):
        return _cut(value, style) if style.strings else _length(value)
    if _is_sequence(value):
        if not style.arrays and described:
            return _array(value, described)
        shown = [_plain(element, style) for element in value[: style.truncate]]
        return [*shown, '...'] if len(shown) < len(value) else shown
    return value.item() if hasattr(value, 'item') else value  # NumPy's scalars


def _cells(value: Any, style: Style, described: str = '') -> Iterator[str]:  # noqa: ANN401
    if _is_message(value):
        for name, kind in _fields(value).items():
            yield from _cells(getattr(value, name), style, kind)
    elif not _is_sequence(value):
        if isinstance(value, str) and not style.strings:
            value = _length(value)
        yield str(_cut(value, style) if isinstance(value, (str, bytes)) else value)
    elif not style.arrays and described:
        yield _array(value, described)
    else:
        shown = [','.join(_cells(element, style)) for element in value[: style.truncate]]
        yield ','.join([*shown, '...'] if len(shown) < len(value) else shown)


def _is_message(value: object) -> bool:
    return hasattr(value, 'get_fields_and_field_types')


def _is_sequence(value: object) -> bool:
    """Return whether `value` is a list, tuple, array.array or NumPy array."""
    return hasattr(value, '__len__') and not isinstance(value, (str, bytes))


def _fields(message: Any) -> dict[str, str]:  # noqa: ANN401
    """Return the fields and their types, as in the .msg file."""
    return dict(message.get_fields_and_field_types())


def _cut(text: Any, style: Style) -> Any:  # noqa: ANN401 (str and bytes alike)
    if style.truncate is None or len(text) <= style.truncate:
        return text
    return text[: style.truncate] + (b'...' if isinstance(text, bytes) else '...')


def _length(text: str) -> str:
    return f'<string length: <{len(text)}>>'


def _array(value: Sequence[Any], described: str) -> str:
    described = described.replace('/', '/msg/')
    if described.startswith('sequence<'):
        element, _, bound = described[len('sequence<') : -1].partition(', ')
        return f'<sequence type: {element}{f"[{bound}]" * bool(bound)}, length: {len(value)}>'
    return f'<array type: {described}>'


def _alternatives(value: object) -> str:
    if _is_message(value):
        return f'not among {", ".join(_fields(value))}'
    if _is_sequence(value):
        return f'not an index below {len(value)}'  # type: ignore[arg-type]
    return f'within a {type(value).__name__}, which has no fields'
