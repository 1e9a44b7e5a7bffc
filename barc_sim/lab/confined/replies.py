"""What the process of a submission may reply: the shape of each reply, with its limits.

The process can send anything, because its code is a stranger's. So a reply has a maximum size for
each request, its numbers become floats whatever they are, and each field is checked.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from barc_sim.lab.confined.child import MAX_TEXT
from barc_sim.lab.files import CALLED, ErrorKind
from barc_sim.lab.user_code.code import MAX_LINES, MAX_NAME, MAX_PLACE
from barc_sim.lab.user_code.folder import MAX_COMMANDS, MAX_PHRASES, TimedCommand

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

_PER_NUMBER = 32  # bytes of a number and its comma
_PER_CHARACTER = 6  # bytes, as in \u00e9
_AROUND = 1000  # bytes of brackets and names of fields


class WrongReply(ValueError):  # noqa: N818 (of the process, no error of the grader)
    """A reply has another shape; the text continues "it returned something other than …"."""


class Shape(Protocol):
    """The type of a value, with its limits."""

    @property
    def size(self) -> int:
        """The maximum number of bytes of JSON."""

    def checked(self, value: object) -> Any:  # noqa: ANN401 (each shape has its own type)
        """Return the value; WrongReply: it has another shape."""


@dataclass(frozen=True)
class Nothing:
    """No value."""

    size: int = _PER_NUMBER

    def checked(self, value: object) -> None:
        """Return None."""
        if value is not None:
            raise WrongReply('no value')


@dataclass(frozen=True)
class Number:
    """A float, which is finite unless `any` is allowed."""

    any: bool = False
    size: int = _PER_NUMBER

    def checked(self, value: object) -> float:
        """Return the number."""
        if type(value) is not float:
            raise WrongReply('a number')
        if not (self.any or isfinite(value)):
            raise WrongReply('finite numbers')
        return value


@dataclass(frozen=True)
class Text:
    """A text of at most `length` characters, in which no character is half of a pair."""

    length: int

    @property
    def size(self) -> int:
        """The maximum number of bytes of JSON."""
        return self.length * _PER_CHARACTER + _PER_NUMBER

    def checked(self, value: object) -> str:
        """Return the text; a surrogate, which no file can hold, becomes an escape."""
        if not isinstance(value, str) or len(value) > self.length:
            raise WrongReply(f'a text of at most {self.length} characters')
        return value.encode(errors='backslashreplace').decode()


@dataclass(frozen=True)
class ListOf:
    """A list of `length` items of one shape, or of fewer if `or_fewer`."""

    item: Shape
    length: int
    or_fewer: bool = False

    @property
    def size(self) -> int:
        """The maximum number of bytes of JSON."""
        return self.length * (self.item.size + _PER_CHARACTER)

    def checked(self, value: object) -> list[Any]:
        """Return the list."""
        minimum = 0 if self.or_fewer else self.length
        if not isinstance(value, list) or not minimum <= len(value) <= self.length:
            raise WrongReply(f'{self.length} rows')
        return [self.item.checked(each) for each in value]


@dataclass(frozen=True)
class Row:
    """A list of values, each with its shape."""

    items: Sequence[Shape]

    @property
    def size(self) -> int:
        """The maximum number of bytes of JSON."""
        return sum(each.size for each in self.items)

    def checked(self, value: object) -> tuple[Any, ...]:
        """Return the values."""
        if not isinstance(value, list) or len(value) != len(self.items):
            raise WrongReply(f'{len(self.items)} values in a row')
        return tuple(item.checked(each) for item, each in zip(self.items, value, strict=True))


@dataclass(frozen=True)
class Optional:
    """A value, or none."""

    item: Shape

    @property
    def size(self) -> int:
        """The maximum number of bytes of JSON."""
        return self.item.size

    def checked(self, value: object) -> Any:  # noqa: ANN401 (of the item)
        """Return the value or None."""
        return None if value is None else self.item.checked(value)


@dataclass(frozen=True)
class Fields:
    """An object with these fields, by name."""

    fields: Mapping[str, Shape]

    @property
    def size(self) -> int:
        """The maximum number of bytes of JSON."""
        return sum(each.size for each in self.fields.values())

    def checked(self, value: object) -> dict[str, Any]:
        """Return the fields."""
        if not isinstance(value, dict) or value.keys() != self.fields.keys():
            raise WrongReply(f'the fields {", ".join(self.fields)}')
        return {name: shape.checked(value[name]) for name, shape in self.fields.items()}


def _results(name: str, rows: Sequence[Any], *_: object) -> Shape:
    """Return the shape of a function's results, a row for each of `rows`."""
    count = CALLED[name].numbers
    return ListOf(Number() if count == 1 else Row([Number()] * count), len(rows))


def _outputs(_: str, __: int, rows: Sequence[Any]) -> Shape:
    """Return the shape of an object's outputs, one for each of `rows`."""
    return ListOf(Number(), len(rows))


_GAINS = Row((Number(), Number(), Number(), Text(MAX_PLACE)))
_COMMANDS = ListOf(Row([Number()] * len(TimedCommand._fields)), MAX_COMMANDS, or_fewer=True)
_LINES = ListOf(Row((Text(MAX_PLACE), Number(any=True))), MAX_LINES, or_fewer=True)
_PHRASES = ListOf(Text(MAX_TEXT), MAX_PHRASES, or_fewer=True)
#: The shape of the result of each request, from its arguments; '' is the first reply.
RESULTS: Mapping[str, Callable[..., Shape]] = {
    '': Nothing,
    'functions': _results,
    'make': lambda *_: Nothing(),
    'steps': _outputs,
    'relay_commands': lambda *_: _COMMANDS,
    'lines': lambda *_: _LINES,
    'notes': lambda: Fields({'gains': Optional(_GAINS), 'tolerated': _PHRASES}),
    'name': lambda: Text(MAX_NAME),
}


def max_size(shape: Shape) -> int:
    """Return the maximum number of bytes of a reply with a result of this shape, or an error."""
    return max(shape.size, Text(MAX_TEXT).size) + _AROUND


class ErrorReply(NamedTuple):
    """An error in a reply: its sentence, and its kind."""

    text: str
    kind: ErrorKind


def parsed(line: bytes, serial: int) -> tuple[object, ErrorReply | None]:
    """Return the result and the error in a reply; ValueError: it is no reply to this request."""
    try:
        # No integer is longer than Python converts, and none is beyond float.
        reply = json.loads(line, parse_int=float)
    except RecursionError:
        raise ValueError('too many brackets within brackets') from None
    if not isinstance(reply, dict) or reply.get('serial') != serial:
        raise ValueError('no reply to this request')
    if reply.get('error') is None:
        return reply.get('result'), None
    text = Text(MAX_TEXT).checked(reply['error'])
    return None, ErrorReply(text, ErrorKind(reply.get('kind') or 'other'))
