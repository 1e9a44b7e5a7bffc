"""Messages without ROS: a class for each .msg and .srv definition, as rclpy has them.

A publisher publishes a copy, so that its message can be used again. To copy a message checks its
fields; the errors have the text of rclpy's own assertions.
"""

from __future__ import annotations

import array
from functools import cache
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg

from barc_sim.interfaces.definitions import store

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

LACKS = 'is not part of the stand-in for ROS 2 (barc_sim/ros/local): install ROS 2 to use it'
_EMPTY = 'structure_needs_at_least_one_member'  # of a message without fields
#: Fields whose default is not zero; rosbags keeps none.
_DEFAULTS: dict[tuple[str, str], Any] = {('geometry_msgs/msg/Quaternion', 'w'): 1.0}
_NUMBERS = 'char float32 float64 int8 uint8 int16 uint16 int32 uint32 int64 uint64'
#: The type code of each in NumPy and `array`; rclpy has lists of all other types.
_CODES = dict(zip(_NUMBERS.split(), 'BfdbBhHiIqQ', strict=True))
_ZERO = {'bool': False, 'string': '', 'byte': b'\0', 'float32': 0.0, 'float64': 0.0}
_PARTS = ('Request', 'Response')
_RESULT = 'bool success\nstring message'
#: The services that runs and students use: request and response.
_SERVICES = {
    'std_srvs/Empty': ('', ''),
    'std_srvs/SetBool': ('bool data', _RESULT),
    'std_srvs/Trigger': ('', _RESULT),
    'rcl_interfaces/SetParameters': ('Parameter[] parameters', 'SetParametersResult[] results'),
}


@cache
def types() -> Typestore:
    """Return the types of messages, with the requests and responses of the services."""
    parts: dict[str, Any] = {}
    for name, texts in _SERVICES.items():
        package, _, short = name.partition('/')
        for part, text in zip(_PARTS, texts, strict=True):
            parts |= get_types_from_msg(text, f'{package}/msg/{short}_{part}')
    store().register(parts)
    return store()


def packages() -> list[str]:
    """Return the packages of all types with their kind, as in `std_msgs.msg` and `std_srvs.srv`."""
    messages = [name for name in types().fielddefs if not name.endswith(_PARTS)]
    services = [name.replace('/', '/srv/') for name in _SERVICES]
    return sorted({name.rpartition('/')[0].replace('/', '.') for name in (*messages, *services)})


@cache
def message_type(name: str) -> type[Any]:
    """Return the class of a message, or a service's with its `Request` and `Response`.

    LookupError: there is no definition of this name.
    """
    package, kind, short = name.split('/')
    if kind == 'srv' and f'{package}/{short}' in _SERVICES:
        parts = {part: _message(f'{package}/msg/{short}_{part}') for part in _PARTS}
        return type(short, (), {**parts, '__module__': f'{package}.srv._{short.lower()}'})
    if kind == 'msg' and name in types().fielddefs:
        return _message(name)
    raise LookupError(f'{name} has no definition here')


class _Byte(bytes):
    """A `byte`, which rosbags serializes as a signed number."""

    def __index__(self) -> int:
        return int.from_bytes(self, 'big', signed=True)


class _List(list):  # type: ignore[type-arg]
    """A list; rosbags serializes the bytes that `view` returns for a list of `bool` or `byte`."""

    def view(self, _: object) -> bytes:
        return bytes(each.__index__() & 255 for each in self)


class _Array(array.array):  # type: ignore[type-arg]
    """An array of numbers as in rclpy, which rosbags can serialize."""

    def view(self, _: object) -> bytes:
        return self.tobytes()


class LocalMessage:
    """A message; the classes of types derive from it."""

    __slots__: tuple[str, ...] = ()
    __msgtype__ = ''
    __copy__: Any  #: returns a copy, whose fields are checked

    def __repr__(self) -> str:
        values = ', '.join(f'{name}={_shown(getattr(self, name))}' for name in self.__slots__)
        return f'{type(self).__module__.rpartition(".")[0]}.{type(self).__name__}({values})'

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and all(
            _plain(getattr(self, name)) == _plain(getattr(other, name)) for name in self.__slots__
        )

    __hash__ = None  # type: ignore[assignment]

    def __serialize__(self) -> bytes:
        """Return the message in CDR."""
        return bytes(types().serialize_cdr(self.__copy__(), self.__msgtype__))


def _shown(value: Any) -> str:
    return repr(_plain(value) if isinstance(value, array.array) else value)


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, 'tolist') else value


class _Field:
    """Makes, checks and copies the values of one field."""

    def __init__(self, owner: str, name: str, kind: Nodetype, of: Any) -> None:
        self.name = name
        self._is_fixed = kind == Nodetype.ARRAY
        self._is_many = kind in (Nodetype.ARRAY, Nodetype.SEQUENCE)
        self._bound: int
        (kind, of), self._bound = of if self._is_many else ((kind, of), 0)
        self._base = of[0] if kind == Nodetype.BASE else ''  # empty: a message
        self._code = _CODES.get(self._base, '')
        default = _DEFAULTS.get((owner, name), _ZERO.get(self._base, 0))
        self.type: type[Any] = type(default) if self._base else _message(of)
        self._make_one = (lambda: default) if self._base else self.type

    def make(self) -> Any:
        """Return the default value."""
        if not self._is_many:
            return self._make_one()
        return self._of([self._make_one() for _ in range(self._bound * self._is_fixed)])

    def _of(self, items: Any) -> Any:
        """Return items in the container that rclpy uses: an array for numbers, else a list."""
        if not self._code:
            return _List(items)
        return np.array(items, self._code) if self._is_fixed else _Array(self._code, items)

    def copy(self, value: Any) -> Any:
        """Return a copy of `value`; AssertionError: it does not fit."""
        if not self._is_many:
            return self._copy_one(value)
        if isinstance(value, (str, dict)) or not hasattr(value, '__len__'):
            self._refuse('a set or sequence')
        if self._is_fixed and len(value) != self._bound:
            self._refuse(f'a set or sequence with length {self._bound}')
        if self._bound and len(value) > self._bound:
            self._refuse(f'a set or sequence with length <= {self._bound}')
        if isinstance(value, array.array) and value.typecode == self._code:
            return self._of(value)
        return self._of([self._copy_one(each) for each in _plain(value)])

    def _copy_one(self, value: Any) -> Any:
        if not isinstance(value, self.type) or (self._base == 'byte' and len(value) != 1):
            self._refuse(f"of type '{self.type.__name__}'")
        if self._base == 'float32':
            return float(np.float32(value))
        if self._base == 'byte':
            return _Byte(value)
        return self.type(value) if self._base else value.__copy__()

    def _refuse(self, expected: str) -> NoReturn:
        raise AssertionError(f'The {self.name!r} field must be {expected}')

    @property
    def quick_copy(self) -> str:
        """The expression for a copy of `v`; it is quick if `v` has exactly the field's type."""
        if self._is_many or self._base in ('byte', 'float32'):
            return f'copy_{self.name}(v)'
        copied = 'v' if self._base else 'v.__copy__()'
        return f'{copied} if v.__class__ is type_{self.name} else copy_{self.name}(v)'


_CLASS = """
class {short}(LocalMessage):
    __slots__ = ({slots})

    def __init__(self{arguments}):
        pass{init}

    def __copy__(self):
        message = new({short}){copy}
        return message
"""


@cache
def _message(name: str) -> type[Any]:
    """Make the class of a message."""
    package, _, short = name.split('/')
    constants, described = types().fielddefs[name]
    fields = {each: _Field(name, each, *of) for each, of in described if each != _EMPTY}
    scope: dict[str, Any] = {'LocalMessage': LocalMessage, 'new': object.__new__}
    for each, field in fields.items():
        scope |= {
            f'type_{each}': field.type,
            f'copy_{each}': field.copy,
            f'make_{each}': field.make,
        }

    def lines(form: str) -> str:
        return ''.join(f'\n        {form.format(n=each, f=fields[each])}' for each in fields)

    source = _CLASS.format(
        short=short,
        slots=''.join(f'"{each}", ' for each in fields),
        arguments=', *, ' + ', '.join(f'{each}=None' for each in fields) if fields else '',
        init=lines('self.{n} = make_{n}() if {n} is None else {n}'),
        copy=lines('v = self.{n}; message.{n} = {f.quick_copy}'),
    )
    exec(source, scope)  # noqa: S102 (from the definitions)
    cls: type[Any] = scope[short]
    cls.__module__ = f'{package}.{"srv" if short.endswith(_PARTS) else "msg"}._{short.lower()}'
    cls.__msgtype__ = name
    if not fields:
        setattr(cls, _EMPTY, 0)  # rosbags serializes it
    for constant, kind, value in constants:
        setattr(cls, constant, bytes([int(value)]) if kind == 'byte' else value)
    return cls
