"""`rospy` for the lab's files of ROS 1, upon `ros/local` in simulated time.

In ROS 1 callbacks run beside the program, also while it sleeps; a message takes its fields by
position, and whole numbers for floats.
"""

from __future__ import annotations

from functools import cache, partial
from string import ascii_lowercase
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from rosbags.typesys import get_types_from_msg

from barc_sim.lab.user_code.importing import Absent
from barc_sim.ros.local.context import init, ok
from barc_sim.ros.local.executor import SECOND, Executor, ExternalShutdownException
from barc_sim.ros.local.messages import message_type, store
from barc_sim.ros.local.node import Node

if TYPE_CHECKING:
    from barc_sim.ros.local.executor import World

#: The messages that the lab's files import, of any package.
_LABS = (
    *('barc_interfaces/msg/ECU', 'barc_interfaces/msg/ZDynBkMdl', 'std_msgs/msg/Header'),
    *('geometry_msgs/msg/Twist', 'geometry_msgs/msg/Vector3'),
)
_LOGS = [f'log{level}' for level in ('debug', 'info', 'warn', 'err', 'fatal')]


def _lenient(type_name: str) -> type[Any]:
    """Return the class of a message as ROS 1 has it; its header comes last."""
    kind: Any = message_type(type_name)
    order = sorted(kind.__fields__, key=lambda name: name == 'header')

    class Lenient(kind):  # type: ignore[misc]
        def __init__(self, *values: Any, **named: Any) -> None:
            super().__init__()
            for name, field in kind.__fields__.items():
                if not (field.is_many or field.base or name == 'header'):
                    setattr(self, name, _lenient(field.type.__msgtype__)())
            for name, value in (*zip(order, values, strict=False), *named.items()):
                setattr(self, name, value)

        def __setattr__(self, name: str, value: Any) -> None:
            is_whole = isinstance(value, int) and not isinstance(value, bool)
            field = kind.__fields__.get(name)
            super().__setattr__(name, float(value) if is_whole and field.type is float else value)

    Lenient.__name__, Lenient.__module__ = kind.__name__, kind.__module__
    return Lenient


class _Seconds(float):
    """A time or a duration [s]."""

    def __new__(cls, secs: float = 0.0, nsecs: float = 0.0) -> _Seconds:  # noqa: PYI034
        return super().__new__(cls, secs + nsecs / SECOND)

    to_sec = float.__float__

    def __sub__(self, other: float) -> _Seconds:
        return _Seconds(float(self) - other)

    def __add__(self, other: float) -> _Seconds:
        return _Seconds(float(self) + other)


class _Rate:
    """Sleeps to the next multiple of its period."""

    def __init__(self, world: World, hz: float, *_: object, **__: object) -> None:
        self._period, self._world = int(SECOND / hz), world
        self._due = world.now() + self._period

    def sleep(self) -> None:
        late = max(self._world.now() - self._due, 0)
        self._due += self._period * -(-late // self._period)
        self._world.sleep(self._due - self._world.now())
        self._due += self._period


@cache
def _key() -> type[Any]:
    """Return the class of a message of the package `keyboard`, whose node sends keys."""
    text = 'std_msgs/Header header\nuint16 code\nuint16 modifiers\n'
    store().register(get_types_from_msg(text, 'keyboard/msg/Key'))
    kind = _lenient('keyboard/msg/Key')
    codes = {'UP': 273, 'DOWN': 274, 'RIGHT': 275, 'LEFT': 276, 'SPACE': 32}
    for name, code in (codes | {letter: ord(letter) for letter in ascii_lowercase}).items():
        setattr(kind, f'KEY_{name}', code)
    return kind


def modules(world: World) -> dict[str, Any]:
    """Return `rospy` and the lab's messages as modules, by name; one node in `world` does all."""
    init(args=[])
    node = Node('rospy_program', enable_rosout=False, start_parameter_services=False)
    executor = Executor()
    executor.add_node(node)
    world.around.append(executor)

    def now() -> _Seconds:
        return _Seconds(world.now_ns / SECOND)

    def subscribe(name: str, data_class: Any, callback: Any, *_: object, **__: object) -> Any:
        return node.create_subscription(message_type(data_class.__msgtype__), name, callback, 1000)

    def publisher(name: str, data_class: Any, *_: object, **__: object) -> SimpleNamespace:
        kind = message_type(data_class.__msgtype__)
        made = node.create_publisher(kind, name, 1000)

        def publish(*values: Any, **named: Any) -> None:
            whole = len(values) == 1 and isinstance(values[0], kind) and not named
            message = values[0] if whole else data_class(*values, **named)
            made.publish(message.__copy__())

        return SimpleNamespace(publish=publish, get_num_connections=made.get_subscription_count)

    def timer(period: float, callback: Any, **_: object) -> object:
        return node.create_timer(period, partial(callback, SimpleNamespace()))

    rospy = Absent('rospy', 'it is not part of what a relay needs')
    vars(rospy).update(
        Subscriber=subscribe,
        Publisher=publisher,
        Rate=partial(_Rate, world),
        Timer=timer,
        Time=type('Time', (_Seconds,), {'now': now, 'from_sec': _Seconds}),
        Duration=_Seconds,
        get_time=lambda: float(now()),
        get_rostime=now,
        get_param=lambda _, default=None: default,
        sleep=lambda seconds: world.sleep(max(round(seconds * SECOND), 0)),
        spin=lambda: world.sleep(10**6 * SECOND),
        is_shutdown=lambda: not ok(),
        ROSInterruptException=ExternalShutdownException,
        **dict.fromkeys(_LOGS, lambda *_: None),
    )
    car = SimpleNamespace(**{name.rpartition('/')[2]: _lenient(name) for name in _LABS})
    car.Z_DynBkMdl = car.ZDynBkMdl
    packages = dict.fromkeys(('barc', 'labs', 'barc_interfaces', 'std_msgs', 'geometry_msgs'), car)
    packages['keyboard'] = SimpleNamespace(Key=_key())
    found = {f'{name}.msg': module for name, module in packages.items()}
    found |= {name: SimpleNamespace(msg=module) for name, module in packages.items()}
    return {'rospy': rospy, **found}
