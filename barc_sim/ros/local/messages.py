"""Messages without ROS: a class for each .msg and .srv definition, as rclpy has them.

A field is checked where it is set, with the words of rclpy's own assertions. What is published is a
copy, so a publisher can use its message again. rosbags serializes.
"""

from __future__ import annotations

import array
from functools import cache
from operator import attrgetter
from struct import Struct
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from barc_sim.bags.schemas import shipped

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_SINGLE = Struct('f')
_EMPTY = 'structure_needs_at_least_one_member'
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
_KINDS = {'bool': bool, 'string': str, 'byte': bytes, 'float32': float, 'float64': float}
_RESULT = 'bool success\nstring message'
#: The services that runs and students use: request and response.
_SERVICES = {
    'std_srvs/Empty': ('', ''),
    'std_srvs/SetBool': ('bool data', _RESULT),
    'std_srvs/Trigger': ('', _RESULT),
    'rcl_interfaces/DescribeParameters': ('string[] names', 'ParameterDescriptor[] descriptors'),
    'rcl_interfaces/GetParameters': ('string[] names', 'ParameterValue[] values'),
    'rcl_interfaces/GetParameterTypes': ('string[] names', 'uint8[] types'),
    'rcl_interfaces/ListParameters': (
        'uint64 DEPTH_RECURSIVE=0\nstring[] prefixes\nuint64 depth',
        'ListParametersResult result',
    ),
    'rcl_interfaces/SetParameters': ('Parameter[] parameters', 'SetParametersResult[] results'),
    'rcl_interfaces/SetParametersAtomically': (
        'Parameter[] parameters',
        'SetParametersResult result',
    ),
}


_PARTS = ('Request', 'Response')


@cache
def _store() -> Typestore:
    """Return the common interfaces of Jazzy, with the lab's messages and the services."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for name, path in shipped():
        if name.startswith('barc_interfaces/'):
            types |= get_types_from_msg(path.read_text(encoding='utf-8'), name)
    for name, parts in _SERVICES.items():
        package, _, short = name.partition('/')
        for part, text in zip(('Request', 'Response'), parts, strict=True):
            types |= get_types_from_msg(text, f'{package}/msg/{short}_{part}')
    store.register(types)
    return store


def packages() -> list[str]:
    """Return the packages of all types with their kind, as in `std_msgs.msg` and `std_srvs.srv`."""
    types = [name for name in _store().fielddefs if not name.endswith(_PARTS)]
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
        return type(short, (), {**parts, '__module__': _module(package, kind, short)})
    if kind == 'msg' and name in _store().fielddefs:
        return _message(name)
    raise LookupError(f'{name} has no definition here')


def _module(package: str, kind: str, short: str) -> str:
    snake = ''.join(f'_{c.lower()}' if c.isupper() else c for c in short)
    return f'{package}.{kind}.{snake}'


class Message:
    """A message; the classes of types derive from it."""

    __slots__ = ()
    __fields__: tuple[str, ...] = ()
    __msgtype__ = ''

    def __repr__(self) -> str:
        values = ', '.join(f'{name}={_shown(getattr(self, name))}' for name in self.__fields__)
        return f'{type(self).__module__.rpartition(".")[0]}.{type(self).__name__}({values})'

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in self.__fields__
        )

    __hash__ = None  # type: ignore[assignment]

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        """Return the fields' types by name, as rclpy writes them."""
        return {name: _rclpy_type(*of) for name, of in _store().fielddefs[cls.__msgtype__][1]}


def _shown(value: Any) -> str:
    return repr(list(value)) if isinstance(value, array.array) else repr(value)


def _rclpy_type(kind: Nodetype, of: Any) -> str:
    if kind == Nodetype.NAME:
        return str(of).replace('/msg/', '/')
    if kind == Nodetype.BASE:
        names = {'float64': 'double', 'float32': 'float', 'bool': 'boolean', 'byte': 'octet'}
        return names.get(of[0], str(of[0])) + (f'<{of[1]}>' if of[1] else '')
    inner, bound = _rclpy_type(*of[0]), of[1]
    if kind == Nodetype.ARRAY:
        return f'{inner}[{bound}]'
    return f'sequence<{inner}, {bound}>' if bound else f'sequence<{inner}>'


class _Field:
    """How the values of one field are made, checked, copied and put on the wire."""

    def __init__(self, owner: str, name: str, kind: Nodetype, of: Any) -> None:
        self.name, self.kind = name, kind
        many: Any = of if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE) else (None, 0)
        self.inner, self.bound = many
        self.plain = kind == Nodetype.BASE and of[0] != 'byte'
        _, base = self.inner or (kind, of)
        self.base = base[0] if isinstance(base, tuple) else ''
        self.length = base[1] if self.base == 'string' else 0
        self.type: type[Any] = _KINDS.get(self.base, int) if self.base else _message(base)
        self.code = _CODES.get(self.base, '') if self.inner else ''
        self.bits = 0 if self.type is not int else 8 * Struct(_CODES[self.base]).size
        signed = self.bits and _CODES[self.base].islower()
        self.low = -(1 << self.bits - 1) if signed else 0
        self.high = (1 << (self.bits - 1 if signed else self.bits)) - 1 if self.bits else 0
        self.default = _DEFAULTS.get((owner, name), _ZERO.get(self.base, 0))

    def make(self) -> Any:
        """Return the default."""
        if self.kind == Nodetype.ARRAY:
            one = [self.type() if not self.base else self.default for _ in range(self.bound)]
            return np.array(one, self.code) if self.code else one
        if self.kind == Nodetype.SEQUENCE:
            return array.array(self.code) if self.code else []
        return self.default if self.base else self.type()

    @property
    def kept(self) -> str:
        """The expression for what is kept of a value `v`: quick where it has the very type."""
        check = f'check_{self.name}(v)'
        if self.inner or self.base in ('byte', 'string'):
            return check
        within = f' and {self.low} <= v <= {self.high}' if self.bits else ''
        return f'v if v.__class__ is type_{self.name}{within} else {check}'

    @property
    def copied(self) -> str:
        """The expression for a copy of the value `v`."""
        if not self.inner:
            single = 'single(*pack(v))' if self.base == 'float32' else 'v'
            return single if self.base else f'type_{self.name}.__copy__(v)'
        if self.code and self.kind == Nodetype.ARRAY:
            return 'v.copy()'
        return f'[type_{self.name}.__copy__(each) for each in v]' if not self.base else 'v[:]'

    def check(self, value: Any) -> Any:
        """Return what is kept of `value`.

        Raises
        ------
        AssertionError
            It does not fit, in rclpy's words.
        """
        if not self.inner:
            return self._check_one(value)
        sized = not isinstance(value, (str, dict)) and hasattr(value, '__len__')
        bound = self.bound if self.kind == Nodetype.SEQUENCE else 0
        if not sized or (bound and len(value) > bound):
            self._refuse(f'a set or sequence{f" with length <= {bound}" if bound else ""}')
        if self.kind == Nodetype.ARRAY and len(value) != self.bound:
            self._refuse(f'a set or sequence with length {self.bound}')
        if isinstance(value, array.array) and value.typecode == self.code:
            return value
        if isinstance(value, np.ndarray):
            value = value.tolist()
        items = [self._check_one(each) for each in value]
        if self.code and self.kind == Nodetype.ARRAY:
            return np.array(items, self.code)
        return array.array(self.code, items) if self.code else items

    def _check_one(self, value: Any) -> Any:
        fits = isinstance(value, self.type) and (self.base != 'byte' or len(value) == 1)
        if not fits or (self.length and len(value) > self.length):
            what = f"of type '{self.type.__name__}'" if self.base else 'a sub message of type'
            self._refuse(what if self.base else f"{what} '{self.type.__name__}'")
        if self.bits and not self.low <= value <= self.high:
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
        if isinstance(value, np.ndarray):
            plain = value.tolist()
            if self.code:
                return self.check(plain)
            return plain
        return value


_MAKE = """
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
    constants, described = _store().fielddefs[name]
    fields = [_Field(name, each, *of) for each, of in described if each != _EMPTY]
    scope: dict[str, Any] = {'Message': Message, 'new': object.__new__}
    scope |= {'pack': lambda v: _SINGLE.unpack(_SINGLE.pack(v)), 'single': float}
    for each in fields:
        scope[f'check_{each.name}'], scope[f'type_{each.name}'] = each.check, each.type
        scope[f'make_{each.name}'], scope[f'wire_{each.name}'] = each.make, each.from_wire

    def lines(form: str) -> str:
        return '\n'.join(
            ' ' * 8 + form.format(n=each.name, kept=each.kept, copied=each.copied, i=index)
            for index, each in enumerate(fields)
        )

    source = _MAKE.format(
        short=short,
        slots=''.join(f'{f"_{each.name}"!r}, ' for each in fields),
        empty='' if fields else f'{_EMPTY} = 0',
        arguments=', *, ' + ', '.join(f'{each.name}=None' for each in fields) if fields else '',
        init=lines('v = make_{n}() if {n} is None else {n}; self._{n} = {kept}'),
        copy=lines('v = m._{n}; n._{n} = {copied}'),
        wire=lines('n._{n} = wire_{n}(values[{i}])'),
        setters='\n'.join(
            f'    def set_{each.name}(self, v):\n        self._{each.name} = {each.kept}'
            for each in fields
        ),
    )
    exec(source, scope)  # noqa: S102 (from the definitions)
    made: type[Any] = scope[short]
    made.__module__ = _module(package, 'srv' if short.endswith(_PARTS) else 'msg', short)
    made.__msgtype__, made.__fields__ = name, tuple(each.name for each in fields)
    made.__wire__ = {each.name: each for each in fields}
    for each in fields:
        get = attrgetter(f'_{each.name}')
        setattr(made, each.name, property(get, getattr(made, f'set_{each.name}')))
        delattr(made, f'set_{each.name}')
    for constant, kind, value in constants:
        setattr(made, constant, bytes([int(value)]) if kind == 'byte' else value)
    made.__plain__ = all(each.plain or _is_plain(each) for each in fields)
    # What rosbags deserializes becomes this class at once.
    _store().types[name] = made.__from_wire__
    return made


def _is_plain(field: _Field) -> bool:
    return field.kind == Nodetype.NAME and bool(field.type.__plain__)


def _to_wire(message: Any) -> Any:
    if message.__plain__:
        return message
    wire = {name: field.to_wire(getattr(message, name)) for name, field in message.__wire__.items()}
    return SimpleNamespace(**wire or {_EMPTY: 0})


def serialize_message(message: Any) -> bytes:
    """Return a message in CDR, as rclpy does."""
    return bytes(_store().serialize_cdr(_to_wire(message), message.__msgtype__))


def deserialize_message(data: bytes, kind: type[Any]) -> Any:
    """Return the message of the class `kind` in CDR, as rclpy does."""
    return _store().deserialize_cdr(data, kind.__msgtype__)
