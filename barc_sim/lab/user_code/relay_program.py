"""Runs a relay that is a whole ROS program, without ROS and in simulated time.

A driver and a car run beside it. The driver publishes Twists on each topic of Twists that the
program subscribes to. A UserCodeError names the program's fault: it fails, has ended, subscribes to
no Twists, publishes nothing on `ecu`, takes too long, or publishes a number that is not finite.

`rospy` is built on `ros/local`. As in ROS 1, callbacks run beside the program, also while it
sleeps; a message takes its fields by position, and integers for floats.
"""

from __future__ import annotations

import threading
from functools import partial
from math import isfinite
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from barc_sim.lab.files import ErrorKind, UserCodeError
from barc_sim.lab.user_code.folder import (
    MAX_COMMANDS,
    Absent,
    AbsentModuleError,
    OutOfTime,
    TimedCommand,
    clock,
)
from barc_sim.ros.local import find_module
from barc_sim.ros.local import world as in_world
from barc_sim.ros.local.executor import Executor, ExternalShutdownException
from barc_sim.ros.local.messages import LocalMessage, message_type
from barc_sim.ros.local.node import Node
from barc_sim.ros.local.program import init, ok, shutdown
from barc_sim.ros.local.qos import HistoryPolicy, QoSProfile
from barc_sim.ros.local.world import SECOND, EndOfTimeError, World

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from barc_sim.lab.user_code.folder import Folder

_BUDGET = 10.0  #: [s] of a run; it takes some milliseconds
_PATIENCE = 5.0  #: [s] until a program that drives by hand must spin or sleep again
_STATE_PERIOD = 0.02  #: [s]
_CMD_VEL = 'cmd_vel'
_STATE = 'z_vhcl'
_ECU = 'ecu'
_ALL = QoSProfile(history=HistoryPolicy.KEEP_ALL)
_TWIST = 'geometry_msgs/msg/Twist'


class _NoThread(threading.Thread):
    def start(self) -> None:
        raise RuntimeError("can't start new thread")


#: The messages that the lab's files import, of any package.
_LABS = (
    *('barc_interfaces/msg/ECU', 'barc_interfaces/msg/ZDynBkMdl', 'std_msgs/msg/Header'),
    *('geometry_msgs/msg/Twist', 'geometry_msgs/msg/Vector3'),
)
_LOGS = [f'log{level}' for level in ('debug', 'info', 'warn', 'err', 'fatal')]


def _lenient(type_name: str) -> type[Any]:
    """Return the class of a message as in ROS 1; the header is the last argument."""
    kind: Any = message_type(type_name)
    order = sorted(kind.__slots__, key=lambda name: name == 'header')

    class Lenient(kind):  # type: ignore[misc]
        def __init__(self, *values: Any, **named: Any) -> None:
            super().__init__()
            for name in kind.__slots__:
                value = getattr(self, name)
                if name != 'header' and isinstance(value, LocalMessage):
                    setattr(self, name, _lenient(value.__msgtype__)())
            for name, value in zip(order, values, strict=False):
                setattr(self, name, value)
            for name, value in named.items():
                setattr(self, name, value)

        def __setattr__(self, name: str, value: Any) -> None:
            is_whole = isinstance(value, int) and not isinstance(value, bool)
            if is_whole and isinstance(getattr(self, name, None), float):
                value = float(value)
            super().__setattr__(name, value)

    Lenient.__name__ = kind.__name__
    Lenient.__module__ = kind.__module__
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
        self._period = int(SECOND / hz)
        self._world = world
        self._due = world.now() + self._period

    def sleep(self) -> None:
        late = max(self._world.now() - self._due, 0)
        self._due += self._period * -(-late // self._period)
        self._world.sleep(self._due - self._world.now())
        self._due += self._period


def rospy_modules(world: World) -> dict[str, Any]:
    """Return `rospy` and the lab's messages as modules, by name; they use one node in `world`."""
    init(args=[])
    node = Node('rospy_program', enable_rosout=False, start_parameter_services=False)
    if world.around:
        world.around.add_node(node)

    def now() -> _Seconds:
        return _Seconds(world.now_ns / SECOND)

    def subscribe(name: str, data_class: Any, callback: Any, *_: object, **__: object) -> Any:
        return node.create_subscription(message_type(data_class.__msgtype__), name, callback, 1000)

    def publisher(name: str, data_class: Any, *_: object, **__: object) -> SimpleNamespace:
        kind = message_type(data_class.__msgtype__)
        node_publisher = node.create_publisher(kind, name, 1000)

        def publish(*values: Any, **named: Any) -> None:
            is_message = len(values) == 1 and isinstance(values[0], kind) and not named
            message = values[0] if is_message else data_class(*values, **named)
            node_publisher.publish(message.__copy__())

        connections = node_publisher.get_subscription_count
        return SimpleNamespace(publish=publish, get_num_connections=connections)

    def timer(period: float, callback: Any, **_: object) -> object:
        return node.create_timer(period, partial(callback, SimpleNamespace()))

    rospy = Absent('rospy', 'a relay does not need it')
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
    modules = {f'{name}.msg': module for name, module in packages.items()}
    modules |= {name: SimpleNamespace(msg=module) for name, module in packages.items()}
    return {'rospy': rospy, **modules}


def prepare() -> None:
    """Load the modules that a program may import, before its process is confined."""
    find_module('rclpy')


class RelayProgram:
    """A ROS 2 or ROS 1 program whose node turns `cmd_vel` into `ecu`."""

    def __init__(self, folder: Folder, path: Path, ros: str) -> None:
        """Use the file at `path`; `ros` is `rclpy` or `rospy`."""
        self.folder = folder
        self.path = path
        self.ros = ros
        self._live: LiveRelay | None = None

    def commands(self, twists: Sequence[Sequence[float]], duration: float) -> list[TimedCommand]:
        """Return its commands on `ecu` from 0 to `duration` [s], while it gets `twists`."""
        run = RelayRun(self, twists, duration)
        self.folder.time_budget(_BUDGET).call(run.run)
        run.check()
        return [run.checked(*command) for command in run.commands]

    def start(self) -> LiveRelay:
        """Start the program for a drive by hand; end an earlier run of it."""
        if self._live:
            self._live.stop()
        self._live = LiveRelay(self, (), 0.0)
        return self._live


class RelayRun(World):
    """A run of a program beside a driver and a car, from time 0 to `end` [s].

    Namespaces are removed from topics: the lab's keyboard has `turtle1/cmd_vel`.
    """

    def __init__(
        self, program: RelayProgram, twists: Sequence[Sequence[float]], end: float
    ) -> None:
        super().__init__(simulated=True)
        self._program = program
        self._publishers: dict[str, Any] = {}  # of the driver, by topic
        self.end = end * SECOND
        self.flat_names = (_CMD_VEL, _STATE, _ECU)
        self.is_silent = True
        self.commands: list[tuple[float, float, float]] = []  #: t [s], motor and servo
        self._published: set[str] = set()  # the program's topics
        self._subscribed: dict[str, str] = {}  # their types
        self._speed = 0.0
        self._motor = 0.0
        self._moved_at = 0.0  # [s]
        state = message_type('barc_interfaces/msg/ZDynBkMdl')
        ecu = message_type('barc_interfaces/msg/ECU')
        with in_world(self):
            init(args=[])
            self.node = Node('car', enable_rosout=False)
            self._state = state()
            self._state_pub = self.node.create_publisher(state, _STATE, _ALL)
            self._ecu_sub = self.node.create_subscription(ecu, _ECU, self._on_command, _ALL)
            for t, linear_x, angular_z in twists:
                self._at(t, partial(self.drive, linear_x, angular_z))
            self._publish_state()
            self.node.create_timer(_STATE_PERIOD, self._publish_state)
            self.around = Executor()
            self.around.add_node(self.node)
            shutdown()  # so that the program can call init

    def _at(self, t: float, call: Callable[[], object]) -> None:
        """Call `call` once, at the time `t` [s]."""

        def once() -> None:
            timer.cancel()
            call()

        timer = self.node.create_timer(t, once)

    def drive(self, linear_x: float, angular_z: float) -> None:
        """Publish a Twist on each topic of Twists that the program subscribes to."""
        message = message_type(_TWIST)()
        message.linear.x = float(linear_x)
        message.angular.z = float(angular_z)
        for topic in self._twist_topics():
            if topic not in self._publishers:
                publisher = self.node.create_publisher(type(message), f'/{topic}', _ALL)
                self._publishers[topic] = publisher
            self._publishers[topic].publish(message)

    def _twist_topics(self) -> set[str]:
        """Return the topics of Twists that the program subscribes to."""
        self._note_topics()
        return {topic for topic, kind in self._subscribed.items() if kind == _TWIST}

    def _on_command(self, command: Any) -> None:
        self._move()
        self._motor = command.motor if isfinite(command.motor) else 0.0
        self.commands.append((self._seconds, command.motor, command.servo))

    def _move(self) -> None:
        self._speed += self._motor * (self._seconds - self._moved_at)
        self._moved_at = self._seconds

    def _publish_state(self) -> None:
        self._note_topics()
        self._move()
        self._state.v_x = self._speed
        self._state_pub.publish(self._state)

    def _note_topics(self) -> None:
        """Note the topics of the program's nodes."""
        for node in self.nodes:
            if node is self.node:
                continue
            for publisher in node.publishers:
                self._published.add(publisher.topic_name.strip('/'))
            for subscription in node.subscriptions:
                topic = subscription.topic_name.strip('/')
                self._subscribed[topic] = subscription.kind.__msgtype__

    @property
    def _seconds(self) -> float:
        """The time [s]."""
        return self.now_ns / SECOND

    def _stand_ins(self) -> Callable[[str], Any]:
        """Return a function from the name of a module to its stand-in for the program."""
        threads = SimpleNamespace(**{**vars(threading), 'Thread': _NoThread})
        modules = {'time': clock(lambda: self.now_ns, self.sleep), 'threading': threads}
        if self._program.ros == 'rospy':
            modules |= rospy_modules(self)
        return lambda name: modules.get(name) or find_module(name)

    def run(self) -> None:
        """Run the program until it ends, or until the time is `end`."""
        folder = self._program.folder.again()
        path = self._program.path
        try:
            with in_world(self):
                folder.stand_in = self._stand_ins()
                module = folder.load(path, '__main__')
                if callable(getattr(module, 'main', None)) and len(self.nodes) == 1:
                    module.main()
        except (EndOfTimeError, SystemExit):
            pass
        except UserCodeError:
            raise
        except (Exception, OutOfTime) as error:
            fault = f'after {self._seconds:.2f} s the relay raised {folder.describe(error)}'
            kind = ErrorKind.OTHER
            if isinstance(error, AbsentModuleError):
                fault = f'the relay uses {error}'
            elif isinstance(error, OutOfTime):
                fault = (
                    f'{self.end / SECOND:g} s of the relay took longer than '
                    f'{error.seconds or _BUDGET:g} s: is there an endless loop?'
                )
                kind = ErrorKind.ENDLESS
            place, _ = folder.raised_at(error)
            raise UserCodeError(f'{place or path.name}: {fault}', kind) from error

        self._note_topics()
        self._published -= {'rosout', 'parameter_events', _ECU}
        while self._ecu_sub.queue:
            self._on_command(self._ecu_sub.queue.popleft())

    def check(self) -> None:
        """Raise a UserCodeError if the program has not acted as a relay."""
        fault = ''
        if len(self.commands) > MAX_COMMANDS:
            fault = (
                f'it publishes more than {MAX_COMMANDS} commands in {self._seconds:g} s: is the '
                'sleep of its loop missing?'
            )
        elif not (self.commands or self.now_ns):
            fault = 'it ends at once, and publishes nothing on ecu: is its spin missing?'
        elif not self.commands:
            topics = ', '.join(map(repr, sorted(self._published)))
            but = f', but on {topics}' if topics else ''
            fault = (
                f'it publishes nothing on ecu{but}; expected commands of the type ECU on the '
                'topic ecu'
            )
        elif not self._twist_topics():
            topics = ', '.join(map(repr, sorted(self._subscribed))) or 'no topic'
            fault = (
                f"it subscribes to {topics}; expected cmd_vel, the topic of the keyboard's Twists"
            )
        if fault:
            raise UserCodeError(f'{self._program.path.name}: {fault}')

    def checked(self, t: float, motor: float, servo: float) -> TimedCommand:
        """Return a command; a UserCodeError if it is not finite."""
        if not (isfinite(motor) and isfinite(servo)):
            raise UserCodeError(
                f'{self._program.path.name}: after {t:.2f} s it published motor {motor!r} and '
                f'servo {servo!r}; expected two finite numbers'
            )
        return TimedCommand(t, motor, servo)


class LiveRelay(RelayRun):
    """A run in a separate thread, for a drive by hand: time passes only during a call."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._failure = ''
        self._is_over = False
        self._continues = threading.Semaphore(0)
        self._waits = threading.Semaphore(0)
        self._thread = threading.Thread(target=self._live, name='relay', daemon=True)
        self._thread.start()
        self._wait()

    def __call__(self, linear_x: float, angular_z: float, *, dt: float) -> tuple[float, float]:
        """Return motor [m/s²] and servo [rad] `dt` seconds after the last call, for a Twist."""
        self.drive(linear_x, angular_z)
        self.end += dt * SECOND
        self._continues.release()
        self._wait()
        if not self.commands:
            return 0.0, 0.0
        del self.commands[:-1]
        _, motor, servo = self.checked(*self.commands[-1])
        return motor, servo

    def at_end(self) -> None:
        """Wait for the next call, at the end of the current one."""
        self._waits.release()
        self._continues.acquire()
        if self._is_over:
            raise EndOfTimeError

    def stop(self) -> None:
        """End the program: while it runs, it blocks the imports of other files."""
        self._is_over = True
        self._continues.release()
        self._thread.join(_PATIENCE)

    def _live(self) -> None:
        try:
            self.run()
            self._failure = f'{self._program.path.name}: the program of the relay has ended'
        except UserCodeError as error:
            self._failure = str(error)
        self._waits.release()

    def _wait(self) -> None:
        if not self._waits.acquire(timeout=_PATIENCE):
            self._failure = (
                f'{self._program.path.name}: the relay did not wait, in a spin or a sleep, within '
                f'{_PATIENCE:g} s'
            )
        if self._failure:
            raise UserCodeError(self._failure)
