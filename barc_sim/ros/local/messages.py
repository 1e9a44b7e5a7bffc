"""Messages without ROS: a class for each .msg and .srv definition, as rclpy has them.

A field is checked where it is set, with the words of rclpy's own assertions. What is published is a
copy, so a publisher can use its message again. rosbags serializes.
"""

from __future__ import annotations

import array
import re
from functools import cache
from operator import attrgetter
from struct import Struct
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from barc_sim.bags.schemas import shipped

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_SINGLE = Struct('f')
_EMPTY = 'structure_needs_at_least_one_member'  # of a message without fields
#: Fields whose default is not zero; rosbags keeps none.
_DEFAULTS: dict[tuple[str, str], Any] = {('geometry_msgs/msg/Quaternion', 'w'): 1.0}
_CODES = {
    'int8': 'b',
    'uint8': 'B',
    'char': 'B',
    'int16': 'h',
    'uint16': 'H',
    'int32': 'i',
    'uint32': 'I',
    'int64': 'q',
    'uint64': 'Q',
    'float32': 'f',
    'float64': 'd',
}
_ZERO = {'bool': False, 'string': '', 'byte': b'\0', 'float32': 0.0, 'float64': 0.0}
_PARTS = ('Request', 'Response')
_RESULT = 'bool success\nstring message'
#: The services that runs and students use: request and response.
_SERVICES = {
    'std_srvs/Empty': ('', ''),
    'std_srvs/SetBool': ('bool data', _RESULT),
    'std_srvs/Trigger': ('', _RESULT),
    'rcl_interfaces/DescribeParameters': ('string[] names', 'ParameterDescriptor[] descriptors'),
    'rcl_interfaces/GetParameters': ('string[] names', 'ParameterValue[] values'),
    'rcl_interfaces/ListParameters': (
        'string[] prefixes\nuint64 depth',
        'ListParametersResult result',
    ),
    'rcl_interfaces/SetParameters': ('Parameter[] parameters', 'SetParametersResult[] results'),
}


@cache
def store() -> Typestore:
    """Return the common interfaces of Jazzy, with the lab's messages and the services."""
    made = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for name, path in shipped():
        if name.startswith('barc_interfaces/'):
            types |= get_types_from_msg(path.read_text(encoding='utf-8'), name)
    for name, parts in _SERVICES.items():
        package, _, short = name.partition('/')
        for part, text in zip(_PARTS, parts, strict=True):
            types |= get_types_from_msg(text, f'{package}/msg/{short}_{part}')
    made.register(types)
    return made


def packages() -> list[str]:
    """Return the packages of all types with their kind, as in `std_msgs.msg` and `std_srvs.srv`."""
    types = [name for name in store().fielddefs if not name.endswith(_PARTS)]
    services = [name.replace('/', '/srv/') for name in _SERVICES]
    return sorted({name.rpartition('/')[0].replace('/', '.') for name in (*types, *services)})


@cache
def message_type(name: str) -> type[Any]:
    """Return the class of a message, or a service's with its `Request` and `Response`.

    Raises
    ------
    LookupError
        There is no definition of this name.
    """
    package, kind, short = name.split('/')
    if kind == 'srv' and f'{package}/{short}' in _SERVICES:
        parts = {part: _message(f'{package}/msg/{short}_{part}') for part in _PARTS}
        return type(short, (), {**parts, '__module__': f'{package}.srv._{short.lower()}'})
    if kind == 'msg' and name in store().fielddefs:
        return _message(name)
    raise LookupError(f'{name} has no definition here')


class Message:
    """A message; the classes of types derive from it."""

    __slots__ = ()
    __fields__: ClassVar[dict[str, _Field]] = {}
    __msgtype__ = ''
    __plain__ = True  # rosbags can serialize it as it is
    __pack__: Any = None  # serializes a header without a frame, and numbers

    def __repr__(self) -> str:
        values = ', '.join(f'{name}={_shown(getattr(self, name))}' for name in self.__fields__)
        return f'{type(self).__module__.rpartition(".")[0]}.{type(self).__name__}({values})'

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in self.__fields__
        )

    __hash__ = None  # type: ignore[assignment]


def _shown(value: Any) -> str:
    return repr(list(value)) if isinstance(value, array.array) else repr(value)


class _Field:
    """How the values of one field are made, checked, copied and put on the wire."""

    def __init__(self, owner: str, name: str, kind: Nodetype, of: Any) -> None:
        self.name, self.fixed = name, kind == Nodetype.ARRAY
        many: Any = of if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE) else (None, 0)
        self.inner, self.bound = many
        _, base = self.inner or (kind, of)
        self.base = base[0] if isinstance(base, tuple) else ''
        self.default = _DEFAULTS.get((owner, name), _ZERO.get(self.base, 0))
        self.type: type[Any] = type(self.default) if self.base else _message(base)
        self.code = _CODES.get(self.base, '') if self.inner else ''
        bits = 8 * Struct(_CODES[self.base]).size if self.type is int else 0
        is_signed = bits and _CODES[self.base].islower()
        self.low = -(1 << bits - 1) if is_signed else 0
        self.high = (1 << bits - bool(is_signed)) - 1
        plain = self.base not in ('', 'byte') or (not self.base and self.type.__plain__)
        self.plain = plain and not self.inner

    def make(self) -> Any:
        """Return the default."""
        if not self.inner:
            return self.default if self.base else self.type()
        one = [self.default if self.base else self.type() for _ in range(self.bound * self.fixed)]
        return self._of(one)

    def _of(self, items: list[Any]) -> Any:
        """Return items as rclpy keeps them: numbers in arrays."""
        if not self.code:
            return items
        return np.array(items, self.code) if self.fixed else array.array(self.code, items)

    @property
    def kept(self) -> str:
        """The expression for what is kept of a value `v`: quick where it has the very type."""
        check = f'check_{self.name}(v)'
        if self.inner or self.base in ('byte', 'string'):
            return check
        within = f' and {self.low} <= v <= {self.high}' if self.type is int else ''
        return f'v if v.__class__ is type_{self.name}{within} else {check}'

    @property
    def copied(self) -> str:
        """The expression for a copy of the value `v`."""
        if self.inner and self.base:
            return 'v.copy()' if self.code and self.fixed else 'v[:]'
        if self.inner:
            return f'[type_{self.name}.__copy__(each) for each in v]'
        single = 'single(v)' if self.base == 'float32' else 'v'
        return single if self.base else f'type_{self.name}.__copy__(v)'

    def check(self, value: Any) -> Any:
        """Return what is kept of `value`.

        Raises
        ------
        AssertionError
            It does not fit, in rclpy's words.
        """
        if not self.inner:
            return self._check_one(value)
        length = f'length {"" if self.fixed else "<= "}{self.bound}'
        if isinstance(value, (str, dict)) or not hasattr(value, '__len__'):
            self._refuse('a set or sequence')
        if self.bound and (len(value) > self.bound or (self.fixed and len(value) < self.bound)):
            self._refuse(f'a set or sequence with {length}')
        if isinstance(value, array.array) and value.typecode == self.code and not self.fixed:
            return value
        items = value.tolist() if isinstance(value, np.ndarray) else value
        return self._of([self._check_one(each) for each in items])

    def _check_one(self, value: Any) -> Any:
        if not isinstance(value, self.type) or (self.base == 'byte' and len(value) != 1):
            what = 'of type' if self.base else 'a sub message of type'
            self._refuse(f"{what} '{self.type.__name__}'")
        if self.type is int and not self.low <= value <= self.high:
            sign = 'an integer' if self.low else 'an unsigned integer'
            self._refuse(f'{sign} in [{self.low}, {self.high}]')
        return self.type(value) if self.base and type(value) is not self.type else value

    def _refuse(self, expected: str) -> None:
        raise AssertionError(f'The {self.name!r} field must be {expected}')

    def to_wire(self, value: Any) -> Any:
        """Return the value as rosbags serializes it."""
        if not self.inner:
            one = int.from_bytes(value, 'big', signed=True) if self.base == 'byte' else value
            return one if self.base else _to_wire(value)
        if not self.base:
            return [_to_wire(each) for each in value]
        if self.base == 'byte':
            return np.frombuffer(b''.join(value), np.int8)
        return value if self.base == 'string' else np.asarray(value, self.code or np.bool_)

    def from_wire(self, value: Any) -> Any:
        """Return the field's value of what rosbags has deserialized."""
        if self.base == 'byte':
            one = np.asarray(value, np.int8).tobytes()
            return [bytes([each]) for each in one] if self.inner else one
        return self._of(value.tolist()) if isinstance(value, np.ndarray) else value


_CLASS = """
class {short}(Message):
    __slots__ = ({slots})
    {empty}
    def __init__(self{arguments}):
        pass
{init}

    @classmethod
    def __copy__(cls, m):
        n = new(cls)
{copy}
        return n

    @classmethod
    def __from_wire__(cls, *values):
        n = new(cls)
{wire}
        return n
{setters}
"""


@cache
def _message(name: str) -> type[Any]:
    """Make the class of a message."""
    package, _, short = name.split('/')
    constants, described = store().fielddefs[name]
    fields = {each: _Field(name, each, *of) for each, of in described if each != _EMPTY}
    scope: dict[str, Any] = {'Message': Message, 'new': object.__new__}
    scope['single'] = lambda v: _SINGLE.unpack(_SINGLE.pack(v))[0]
    for each, field in fields.items():
        scope[f'check_{each}'], scope[f'type_{each}'] = field.check, field.type
        scope[f'make_{each}'], scope[f'wire_{each}'] = field.make, field.from_wire

    def lines(form: str) -> str:
        return '\n'.join(
            ' ' * 8 + form.format(n=each, kept=field.kept, copied=field.copied, i=index)
            for index, (each, field) in enumerate(fields.items())
        )

    source = _CLASS.format(
        short=short,
        slots=''.join(f'"_{each}", ' for each in fields),
        empty='' if fields else f'{_EMPTY} = 0',
        arguments=', *, ' + ', '.join(f'{each}=None' for each in fields) if fields else '',
        init=lines('v = make_{n}() if {n} is None else {n}; self._{n} = {kept}'),
        copy=lines('v = m._{n}; n._{n} = {copied}'),
        wire=lines('n._{n} = wire_{n}(values[{i}])'),
        setters='\n'.join(
            f'    def _set_{each}(self, v):\n        self._{each} = {field.kept}'
            for each, field in fields.items()
        ),
    )
    exec(source, scope)  # noqa: S102 (from the definitions)
    made: type[Any] = scope[short]
    made.__module__ = f'{package}.{"srv" if short.endswith(_PARTS) else "msg"}._{short.lower()}'
    made.__msgtype__, made.__fields__ = name, fields
    made.__plain__ = all(field.plain for field in fields.values())
    for each in fields:
        setattr(made, each, property(attrgetter(f'_{each}'), getattr(made, f'_set_{each}')))
    for constant, kind, value in constants:
        setattr(made, constant, bytes([int(value)]) if kind == 'byte' else value)
    codes = ''.join({'float64': 'd', 'bool': '?'}.get(field.base, 'x') for field in fields.values())
    first = next(iter(fields.values()), None)
    if re.fullmatch(r'x(?=..)d*\?*', codes) and first and first.type is _header_type(name):
        # An empty frame is a string of one byte; the fields begin at a multiple of eight.
        made.__pack__ = Struct(f'<4siI5s3x{codes[1:]}').pack
        made.__values__ = attrgetter(*(f'_{each}' for each in [*fields][1:]))
    # What rosbags deserializes becomes this class at once.
    store().types[name] = made.__from_wire__
    return made


def _header_type(name: str) -> Any:
    """Return the class of a header, for all other types."""
    return None if name == 'std_msgs/msg/Header' else _message('std_msgs/msg/Header')


def _to_wire(message: Any) -> Any:
    if message.__plain__:
        return message
    wire = {
        name: field.to_wire(getattr(message, name)) for name, field in message.__fields__.items()
    }
    return SimpleNamespace(**wire)


def serialize_message(message: Any) -> bytes:
    """Return a message in CDR, as rclpy does."""
    if message.__pack__ and not message.header.frame_id:
        stamp, values = message.header.stamp, message.__values__(message)
        return bytes(
            message.__pack__(b'\0\1\0\0', stamp.sec, stamp.nanosec, b'\1\0\0\0\0', *values)
        )
    return bytes(store().serialize_cdr(_to_wire(message), message.__msgtype__))


def deserialize_message(data: bytes, kind: type[Any]) -> Any:
    """Return the message of the class `kind` in CDR, as rclpy does."""
    return store().deserialize_cdr(data, kind.__msgtype__)
