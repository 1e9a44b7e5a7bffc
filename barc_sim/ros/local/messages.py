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
    from collections.abc import Mapping

    from rosbags.typesys.store import Typestore

LACKS = 'is not part of the stand-in for ROS 2 (barc_sim/ros/local): install ROS 2 to use it'
_EMPTY = 'structure_needs_at_least_one_member'  # of a message without fields
#: Fields whose default is not zero; rosbags keeps none.
_DEFAULTS: dict[tuple[str, str], Any] = {('geometry_msgs/msg/Quaternion', 'w'): 1.0}
#: The type code of each number in NumPy and `array`; rclpy has lists of all other types.
_CODES = {
    'char': 'B',
    'float32': 'f',
    'float64': 'd',
    'int8': 'b',
    'uint8': 'B',
    'int16': 'h',
    'uint16': 'H',
    'int32': 'i',
    'uint32': 'I',
    'int64': 'q',
    'uint64': 'Q',
}
#: The defaults of types; that of whole numbers is 0.
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
    """Return the class of a message or a service.

    Parameters
    ----------
    name
        Its full name, such as `std_msgs/msg/String`.

    Returns
    -------
    type
        The class; that of a service has `Request` and `Response`.

    Raises
    ------
    LookupError
        There is no definition of this name.
    """
    package, kind, short = name.split('/')
    if kind == 'msg' and name in types().fielddefs:
        return _message(name)
    if kind == 'srv' and f'{package}/{short}' in _SERVICES:
        members: dict[str, Any] = {'__module__': f'{package}.srv._{short.lower()}'}
        for part in _PARTS:
            members[part] = _message(f'{package}/msg/{short}_{part}')
        return type(short, (), members)
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
        if type(self) is not type(other):
            return False
        return all(
            _plain(getattr(self, name)) == _plain(getattr(other, name)) for name in self.__slots__
        )

    __hash__ = None  # type: ignore[assignment]

    def __serialize__(self) -> bytes:
        """Return the message in CDR."""
        return bytes(types().serialize_cdr(self.__copy__(), self.__msgtype__))


def _shown(value: Any) -> str:
    """Return the text of a value in a message's: an array of numbers is shown as a list."""
    if isinstance(value, array.array):
        return repr(value.tolist())
    return repr(value)


def _plain(value: Any) -> Any:
    """Return an array as a list, and any other value as it is."""
    if hasattr(value, 'tolist'):
        return value.tolist()
    return value


class _Field:
    """Makes, checks and copies the values of one field.

    Parameters
    ----------
    owner
        The name of the message's type.
    name
        The name of the field.
    kind, described
        What rosbags has of the field: whether it is one element, or many of them, and which. Many
        are described by the kind and the description of an element, and their number: exactly as
        many of an array, at most as many of a sequence, 0 for any.

    Attributes
    ----------
    type
        The class of an element.
    """

    def __init__(self, owner: str, name: str, kind: Nodetype, described: Any) -> None:
        self.name = name
        self._is_fixed = kind == Nodetype.ARRAY
        self._is_many = kind in (Nodetype.ARRAY, Nodetype.SEQUENCE)
        self._bound = 0
        if self._is_many:
            (kind, described), self._bound = described

        self._base = ''  # the name of the element's type; empty: it is a message
        self._default: Any = None
        self.type: type[Any]
        if kind == Nodetype.BASE:
            self._base, _ = described
            self._default = _DEFAULTS.get((owner, name), _ZERO.get(self._base, 0))
            self.type = type(self._default)
        else:
            self.type = _message(described)
        self._code = _CODES.get(self._base, '')  # empty: it is no number

    def make(self) -> Any:
        """Return the default value."""
        if not self._is_many:
            return self._make_element()
        count = self._bound if self._is_fixed else 0
        return self._contain([self._make_element() for _ in range(count)])

    def _make_element(self) -> Any:
        if self._base:
            return self._default
        return self.type()

    def _contain(self, elements: Any) -> Any:
        """Return elements in the container that rclpy uses: an array for numbers, else a list."""
        if not self._code:
            return _List(elements)
        if self._is_fixed:
            return np.array(elements, self._code)
        return _Array(self._code, elements)

    def copy(self, value: Any) -> Any:
        """Return a copy of `value`; AssertionError: it does not fit."""
        if not self._is_many:
            return self._copy_element(value)

        if isinstance(value, (str, dict)) or not hasattr(value, '__len__'):
            self._refuse('a set or sequence')
        if self._is_fixed and len(value) != self._bound:
            self._refuse(f'a set or sequence with length {self._bound}')
        if self._bound and len(value) > self._bound:
            self._refuse(f'a set or sequence with length <= {self._bound}')

        if isinstance(value, array.array) and value.typecode == self._code:
            return self._contain(value)  # its numbers fit
        return self._contain([self._copy_element(each) for each in _plain(value)])

    def _copy_element(self, value: Any) -> Any:
        if not isinstance(value, self.type) or (self._base == 'byte' and len(value) != 1):
            self._refuse(f"of type '{self.type.__name__}'")
        if not self._base:
            return value.__copy__()
        if self._base == 'float32':
            return float(np.float32(value))
        if self._base == 'byte':
            return _Byte(value)
        return self.type(value)

    def _refuse(self, expected: str) -> NoReturn:
        raise AssertionError(f'The {self.name!r} field must be {expected}')

    @property
    def quick_copy(self) -> str:
        """The expression for a copy of `v`; it is quick if `v` has exactly the field's type."""
        if self._is_many or self._base in ('byte', 'float32'):
            return f'copy_{self.name}(v)'
        copied = 'v' if self._base else 'v.__copy__()'  # a number or text cannot change
        return f'{copied} if v.__class__ is type_{self.name} else copy_{self.name}(v)'


#: The class of a message, compiled from text: a copy calls no function for a field that fits.
_CLASS = """
class {short}(LocalMessage):
    __slots__ = ({slots})

    def __init__(self{arguments}):
        pass{init}

    def __copy__(self):
        message = new({short}){copy}
        return message
"""
_LINE = '\n        '


@cache
def _message(name: str) -> type[Any]:
    """Make the class of a message."""
    package, _, short = name.split('/')
    constants, described = types().fielddefs[name]
    fields = {}
    for field_name, kind_and_description in described:
        if field_name != _EMPTY:
            fields[field_name] = _Field(name, field_name, *kind_and_description)

    cls: type[Any] = _compiled_class(short, fields)
    part = 'srv' if short.endswith(_PARTS) else 'msg'
    cls.__module__ = f'{package}.{part}._{short.lower()}'
    cls.__msgtype__ = name
    if not fields:
        setattr(cls, _EMPTY, 0)  # rosbags serializes it
    for constant, kind, value in constants:
        setattr(cls, constant, bytes([int(value)]) if kind == 'byte' else value)
    return cls


def _compiled_class(short: str, fields: Mapping[str, _Field]) -> Any:
    """Return a class of this name, whose constructor and copy know the fields."""
    scope: dict[str, Any] = {'LocalMessage': LocalMessage, 'new': object.__new__}
    slots = ''
    init = ''
    copy = ''
    for name, field in fields.items():
        scope[f'type_{name}'] = field.type
        scope[f'copy_{name}'] = field.copy
        scope[f'make_{name}'] = field.make
        slots += f'"{name}", '
        init += f'{_LINE}self.{name} = make_{name}() if {name} is None else {name}'
        copy += f'{_LINE}v = self.{name}{_LINE}message.{name} = {field.quick_copy}'

    arguments = ''
    if fields:
        arguments = ', *, ' + ', '.join(f'{name}=None' for name in fields)
    source = _CLASS.format(short=short, slots=slots, arguments=arguments, init=init, copy=copy)
    exec(source, scope)  # noqa: S102 (from the definitions)
    return scope[short]
