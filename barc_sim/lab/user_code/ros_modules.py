"""Stand-ins for `rospy`, `rclpy` and `time`, which run a program in a `World`."""

from __future__ import annotations

from functools import total_ordering
from math import isfinite
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from barc_sim.lab.user_code.absent import Absent
from barc_sim.lab.user_code.ros_messages import messages
from barc_sim.lab.user_code.ros_world import Subscription, Timer, World

if TYPE_CHECKING:
    from collections.abc import Callable

_NANOSECONDS = 1_000_000_000
_REASON = 'it is not part of what a relay needs'
_FOREVER = 1e9  #: [s]


def modules(world: World, *, ros_1: bool) -> dict[str, Any]:
    """Return the stand-ins by name; where a program imports another module of ROS, see `Absent`."""
    named = messages(strict=not ros_1)
    clock = SimpleNamespace(
        time=lambda: world.now,
        monotonic=lambda: world.now,
        perf_counter=lambda: world.now,
        time_ns=lambda: round(world.now * _NANOSECONDS),
        monotonic_ns=lambda: round(world.now * _NANOSECONDS),
        sleep=lambda seconds: world.wait(float(seconds), spinning=False),
    )
    return {'time': clock, **named, **(_rospy(world) if ros_1 else _rclpy(world))}


class _Publisher:
    def __init__(self, world: World, topic: str, kind: Any) -> None:  # noqa: ANN401 (a program's)
        self._world, self._topic, self._kind = world, topic, kind

    def publish(self, *values: Any, **named: Any) -> None:  # noqa: ANN401 (a program's)
        """Publish a message, or one of these fields as in ROS 1."""
        whole = len(values) == 1 and not named and not isinstance(values[0], (int, float))
        self._world.publish(self._topic, values[0] if whole else self._kind(*values, **named))

    def get_num_connections(self) -> int:
        """Return how many nodes subscribe to the topic."""
        return 1

    get_subscription_count = get_num_connections


@total_ordering
class _Time:  # noqa: PLW1641 (nothing hashes a time)
    """A time or a duration [s]."""

    def __init__(self, seconds: float = 0.0, nanoseconds: float = 0, **_: object) -> None:
        self.seconds = float(seconds) + float(nanoseconds) / _NANOSECONDS

    @property
    def nanoseconds(self) -> int:
        """The same in nanoseconds."""
        return round(self.seconds * _NANOSECONDS)

    def to_sec(self) -> float:
        """Return the seconds."""
        return self.seconds

    def to_msg(self) -> SimpleNamespace:
        """Return the message."""
        sec, nanosec = divmod(self.nanoseconds, _NANOSECONDS)
        return SimpleNamespace(sec=sec, nanosec=nanosec)

    def __sub__(self, other: _Time) -> _Time:
        return _Time(self.seconds - other.seconds)

    def __add__(self, other: _Time) -> _Time:
        return _Time(self.seconds + other.seconds)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Time) and self.seconds == other.seconds

    def __lt__(self, other: _Time) -> bool:
        return self.seconds < other.seconds


class _Rate:
    def __init__(self, world: World, frequency: float) -> None:
        if not (isfinite(frequency) and frequency > 0.0):
            raise ValueError(f'a rate of {frequency!r} Hz: expected a number above 0')
        self._world, self._period, self._last = world, 1.0 / frequency, world.now

    def sleep(self) -> None:
        """Wait for the next period."""
        self._last = self._world.wait_for_turn(self._period, self._last)


def _open(name: str, **values: object) -> Absent:
    """Return a module with these values; any other name in it is an `Absent`."""
    module = Absent(name, _REASON)
    vars(module).update(values)
    return module


def _silent(*_: object, **__: object) -> None:
    """Do nothing, as a logger of a program that is judged."""


def _rospy(world: World) -> dict[str, Any]:
    def subscriber(
        name: str,
        data_class: type,
        callback: Callable[..., object] = _silent,
        callback_args: object = None,
        **_: object,
    ) -> SimpleNamespace:
        call = callback
        if callback_args is not None:
            call = lambda message: callback(message, callback_args)  # noqa: E731
        world.subscriptions.append(Subscription(name, data_class, call, queued=False))
        return SimpleNamespace(unregister=_silent)

    def sleep(time: _Time | float) -> None:
        world.wait(time.seconds if isinstance(time, _Time) else time, spinning=False)

    def timer(period: _Time, callback: Callable[..., object], **_: object) -> object:
        def fire() -> None:
            callback(SimpleNamespace(current_real=world.now))

        return Timer(world, period.seconds, fire, queued=False)

    class Time(_Time):
        @staticmethod
        def now() -> _Time:
            return _Time(world.now)

        from_sec = _Time

    class Interrupted(Exception):  # noqa: N818
        pass

    rospy = _open(
        'rospy',
        Subscriber=subscriber,
        Publisher=lambda name, data_class=None, *_, **__: _Publisher(world, name, data_class),
        Rate=lambda hz, *_, **__: _Rate(world, float(hz)),
        Timer=timer,
        Time=Time,
        Duration=_Time,
        get_time=lambda: world.now,
        get_rostime=lambda: _Time(world.now),
        get_param=lambda _, default=None: default,
        sleep=sleep,
        spin=lambda: world.wait(_FOREVER, spinning=True),
        is_shutdown=world.is_over,
        ROSInterruptException=Interrupted,
    )
    return {'rospy': rospy}


class _Node:
    """The node of ROS 2."""

    world: World

    def __init__(self, node_name: str = 'relay', **_: object) -> None:
        self._node_name = node_name
        self._parameters: dict[str, object] = {}

    def create_publisher(self, kind: type, topic: str, *_: object, **__: object) -> _Publisher:
        return _Publisher(self.world, topic, kind)

    def create_subscription(
        self, kind: type, topic: str, callback: Callable[[Any], object], *_: object, **__: object
    ) -> Subscription:
        self.world.subscriptions.append(Subscription(topic, kind, callback, queued=True))
        return self.world.subscriptions[-1]

    def create_timer(
        self, timer_period_sec: float, callback: Callable[[], object], *_: object, **__: object
    ) -> object:
        return Timer(self.world, timer_period_sec, callback, queued=True)

    def create_rate(self, frequency: float, *_: object, **__: object) -> _Rate:
        return _Rate(self.world, frequency)

    def get_clock(self) -> SimpleNamespace:
        return SimpleNamespace(now=lambda: _Time(self.world.now))

    def get_name(self) -> str:
        return self._node_name

    def declare_parameter(self, name: str, value: object = None, *_: object) -> SimpleNamespace:
        self._parameters[name] = value
        return self.get_parameter(name)

    def get_parameter(self, name: str) -> SimpleNamespace:
        value = self._parameters[name]
        kinds = ('double', 'integer', 'bool', 'string')
        typed = SimpleNamespace(**{f'{kind}_value': value for kind in kinds})
        return SimpleNamespace(value=value, get_parameter_value=lambda: typed)

    def __getattr__(self, name: str) -> object:
        if name in _NODE_METHODS:
            return Absent(f'node.{name}', _REASON)
        raise AttributeError(f'{type(self).__name__!r} object has no attribute {name!r}')


#: Other methods of a node: a relay does not need what they return.
_NODE_METHODS = (
    *('create_service', 'create_client', 'create_guard_condition', 'get_logger', 'destroy_node'),
    *('add_on_set_parameters_callback', 'set_parameters', 'has_parameter', 'get_namespace'),
    *('count_publishers', 'count_subscribers', 'declare_parameters', 'context', 'executor'),
)


def _rclpy(world: World) -> dict[str, Any]:
    node_class = type('Node', (_Node,), {'world': world})

    def spin(*_: object, **__: object) -> None:
        world.wait(_FOREVER, spinning=True)

    def spin_once(*_: object, timeout_sec: float | None = None, **__: object) -> None:
        seconds = _FOREVER if timeout_sec is None else float(timeout_sec)
        world.wait(max(seconds, 1e-3), spinning=True, once=True)

    class Executor:
        def __init__(self, *_: object, **__: object) -> None:
            self.add_node = self.remove_node = self.shutdown = _silent
            self.spin, self.spin_once = spin, spin_once

    class Interrupted(Exception):  # noqa: N818
        pass

    nodes = _open('rclpy.node', Node=node_class)
    executors = _open(
        'rclpy.executors',
        SingleThreadedExecutor=Executor,
        MultiThreadedExecutor=Executor,
        ExternalShutdownException=Interrupted,
    )
    times = {'rclpy.time': _open('rclpy.time', Time=_Time)}
    times['rclpy.duration'] = _open('rclpy.duration', Duration=_Time)
    rclpy = _open(
        'rclpy',
        ok=lambda *_, **__: not world.is_over(),
        spin=spin,
        spin_once=spin_once,
        create_node=node_class,
        node=nodes,
        executors=executors,
        time=times['rclpy.time'],
        duration=times['rclpy.duration'],
    )
    return {'rclpy': rclpy, 'rclpy.node': nodes, 'rclpy.executors': executors, **times}
