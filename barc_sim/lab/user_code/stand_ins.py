"""What takes the place of a terminal and of `rospy` for a relay's program, in simulated time.

Nothing reads the real terminal, so that a program gets the same keys at the same times on every
machine, also where it is confined. `rospy` is upon `ros/local`: in ROS 1 callbacks run beside the
program, also while it sleeps; a message takes its fields by position, and whole numbers for floats.
"""

from __future__ import annotations

import os
import select
import sys
import threading
from collections import deque
from functools import cache, partial
from math import inf
from string import ascii_lowercase
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from rosbags.typesys import get_types_from_msg

from barc_sim.lab.user_code.importing import Absent
from barc_sim.ros.local.executor import SECOND, Executor, ExternalShutdownException
from barc_sim.ros.local.messages import message_type, store
from barc_sim.ros.local.node import Node, init, ok

if TYPE_CHECKING:
    from collections.abc import Sequence

    from barc_sim.ros.local.executor import World

#: The keys for up, down, left and right that programs use; the likelier ones last, except `w s`,
#: because a program for `w x` can stop at s.
LAYOUTS = {
    'arrows': ('\x1b[A', '\x1b[B', '\x1b[D', '\x1b[C'),
    'w x a d': tuple('wxad'),
    'w s a d': tuple('wsad'),
    'i , j l': tuple('i,jl'),
    'i k j l': tuple('ikjl'),
    '8 2 4 6': tuple('8246'),
}
STOP = ' '  #: the key that stops in most programs, as any other key does
#: The codes of the arrows in `keyboard/Key`; other keys have their letters' codes.
CODES = dict(zip(LAYOUTS['arrows'], (273, 274, 276, 275), strict=True))
#: What reads keys in another way, words.
_ELSEWHERE = 'curses getch getkey pygame pynput readchar tkinter Tkinter'
_SET_FLAGS = 4  # as on Linux
_TICK = 1_000_000  # [ns] that a look for a key takes at least, so that a busy loop takes time


class _Constants(SimpleNamespace):
    """A module whose other names are 0: its constants, which nothing reads."""

    def __getattr__(self, _: str) -> int:
        return 0


class _NoThread(threading.Thread):
    def start(self) -> None:
        raise RuntimeError("can't start new thread")


class Terminal:
    """The standard input of a program; `type` adds keys."""

    def __init__(self, world: World) -> None:
        self.use = ''  #: how the program reads keys, as the rest of a sentence; empty: it does not
        self._world, self._typed = world, deque[str]()
        self._patience: float | None = None  # [s] of a read; None: for ever

    def type(self, keys: str) -> None:
        """Add the characters of keys, which are read one by one."""
        self._typed.extend(keys)

    def _wait(self, seconds: float | None) -> bool:
        """Let time pass until there is a character, at most for so long."""
        self.use = self.use or 'reads the terminal'
        now = self._world.now_ns
        until = inf if seconds is None else now + max(int(seconds * SECOND), _TICK)
        while not self._typed and self._world.now_ns < until:
            self._world.pass_time(until)
        return bool(self._typed)

    def read(self, size: int = 1) -> str:
        """Return so many characters, fewer where a read does not wait for them."""
        found = ''
        while len(found) < size and self._wait(self._patience):
            found += self._typed.popleft()
        return found

    def readline(self, prompt: object = '') -> str:
        """Return a line: one key."""
        del prompt
        return f'{self.read()}\n'

    def fileno(self) -> int:
        """Return the number of the standard input."""
        return 0

    def isatty(self) -> bool:
        """Return True."""
        return True

    @property
    def buffer(self) -> SimpleNamespace:
        """The same, in bytes."""
        return SimpleNamespace(read=lambda size=1: self.read(size).encode())

    def _select(
        self,
        readers: Sequence[Any],
        writers: Sequence[Any],
        _: object,
        timeout: float | None = None,
    ) -> tuple[list[Any], Sequence[Any], list[Any]]:
        own = [each for each in readers if each in (0, self)]
        return (own if own and self._wait(timeout) else []), writers, []

    def _read_file(self, file: int, size: int) -> bytes:
        if file:
            return os.read(file, size)
        if keys := self.read(min(size, max(len(self._typed), 1))):
            return keys.encode()
        raise BlockingIOError('Resource temporarily unavailable')

    def _attributes(self, *_: object) -> list[Any]:
        self.use = self.use or 'reads the terminal'
        return [0, 0, 0, 0, 0, 0, [0] * 32]

    def _set_flags(self, _: object, command: int = 0, flags: int = 0) -> int:
        if command == _SET_FLAGS:
            self._patience = 0.0 if flags & getattr(os, 'O_NONBLOCK', 0) else None
        return 0

    def modules(self) -> dict[str, Any]:
        """Return the modules with which a program reads keys."""
        return {
            'sys': SimpleNamespace(**{**vars(sys), 'stdin': self}),
            'os': SimpleNamespace(**{**vars(os), 'read': self._read_file}),
            'select': SimpleNamespace(**{**vars(select), 'select': self._select}),
            'threading': SimpleNamespace(**{**vars(threading), 'Thread': _NoThread}),
            'tty': SimpleNamespace(setraw=self._attributes, setcbreak=self._attributes),
            'termios': _Constants(
                error=OSError,
                tcgetattr=self._attributes,
                tcsetattr=self._attributes,
                tcflush=lambda *_: self._typed.clear(),
            ),
            'fcntl': _Constants(F_SETFL=_SET_FLAGS, fcntl=self._set_flags),
        }

    def elsewhere(self, name: str) -> Absent | None:
        """Return what stands for a module that reads keys in a way that nobody can type for."""
        top = name.partition('.')[0]
        if top not in _ELSEWHERE.split():
            return None
        self.use = f'uses {top}'
        return Absent(name, f'{top} reads keys, and no keys are typed for it')


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


def rospy_modules(world: World) -> dict[str, Any]:
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
