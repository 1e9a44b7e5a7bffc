"""Stand-ins for the messages of a relay's program."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable


class _Fields:
    """A message: its fields by name or, in ROS 1, by position.

    In ROS 2 a field of numbers takes a float alone, and a message has no field beside its own.
    """

    fields: tuple[str, ...] = ()
    strict = True

    def __init__(self, *values: object, **named: object) -> None:
        if self.strict and values:
            raise TypeError(f'{type(self).__name__}() takes its fields by name')
        for name in self.fields:
            super().__setattr__(name, _PARTS[name]() if name in _PARTS else 0.0)
        for name, value in (*zip(self.fields, values, strict=False), *named.items()):
            setattr(self, name, value)

    def __setattr__(self, name: str, value: object) -> None:
        if name not in self.fields:
            raise AttributeError(f'{type(self).__name__!r} object has no attribute {name!r}')
        if self.strict and name not in _PARTS and not isinstance(value, float):
            raise AssertionError(f"The {name!r} field must be of type 'float'")
        super().__setattr__(name, value)

    def __repr__(self) -> str:
        values = ', '.join(f'{name}={getattr(self, name)!r}' for name in self.fields)
        return f'{type(self).__name__}({values})'


class Vector3(_Fields):
    """`geometry_msgs/Vector3`."""

    fields = ('x', 'y', 'z')


def _stamped() -> SimpleNamespace:
    return SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0), frame_id='', seq=0)


#: Fields that are messages themselves.
_PARTS: dict[str, Callable[[], Any]] = {
    'header': _stamped,
    'linear': Vector3,
    'angular': Vector3,
    'twist': lambda: SimpleNamespace(linear=Vector3(), angular=Vector3()),
}
_STATE = ('x', 'y', 'psi', 'v_x', 'v_y', 'psi_dot')


def messages(*, strict: bool) -> dict[str, Any]:
    """Return the modules of messages."""

    def message(name: str, *fields: str) -> type[_Fields]:
        return type(name, (_Fields,), {'fields': fields, 'strict': strict})

    # In ROS 1 the command has no header: its fields by position are motor and servo.
    ecu = message('ECU', 'motor', 'servo', *(['header'] if strict else []))
    state = message('ZDynBkMdl', *_STATE, 'header')
    car = SimpleNamespace(ECU=ecu, ZDynBkMdl=state, Z_DynBkMdl=state)
    vector = type('Vector3', (Vector3,), {'strict': strict})
    twists = SimpleNamespace(Twist=message('Twist', 'linear', 'angular'), Vector3=vector)
    packages = {'barc': car, 'labs': car, 'barc_interfaces': car, 'geometry_msgs': twists}
    found: dict[str, Any] = {f'{name}.msg': module for name, module in packages.items()}
    found |= {name: SimpleNamespace(msg=module) for name, module in packages.items()}
    found['std_msgs.msg'] = SimpleNamespace(Header=lambda *_, **__: _stamped())
    return found
