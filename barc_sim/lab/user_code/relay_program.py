"""A relay that is a whole program of ROS, run without ROS in simulated time.

Around it are a driver and a car. The driver sends Twists on each topic of Twists that the program
listens to, or presses keys where it reads these itself. A UserCodeError names what is wrong with
the program: it fails, has ended, listens to no driver, publishes nothing on `ecu`, takes too long,
or publishes a number that is not finite.
"""

from __future__ import annotations

import threading
import time
from functools import cached_property, partial
from math import isfinite
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from barc_sim.lab.user_code.calls import (
    BY_EYE,
    MAX_COMMANDS,
    Budget,
    Command,
    OutOfTime,
    describe_error,
    raised_at,
)
from barc_sim.lab.user_code.importing import AbsentModuleError
from barc_sim.lab.user_code.source import UserCodeError
from barc_sim.lab.user_code.stand_ins import CODES, LAYOUTS, STOP, Terminal, rospy_modules
from barc_sim.ros.local import find_module
from barc_sim.ros.local import world as in_world
from barc_sim.ros.local.executor import SECOND, EndOfTimeError, Executor, World
from barc_sim.ros.local.messages import message_type
from barc_sim.ros.local.node import HistoryPolicy, Node, QoSProfile, init, shutdown

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from barc_sim.lab.user_code.importing import Folder

_BUDGET = 10.0  #: [s] of a run; it takes some milliseconds
_PATIENCE = 5.0  #: [s] for a program to wait again, while it drives
_STATE_PERIOD = 0.02  #: [s]
_CMD_VEL, _STATE, _ECU = _TOPICS = 'cmd_vel', 'z_vhcl', 'ecu'
_ALL = QoSProfile(history=HistoryPolicy.KEEP_ALL)
_TWIST, _KEY = 'geometry_msgs/msg/Twist', 'keyboard/msg/Key'
_TAP = 0.5  #: [s] between two presses of a key that is judged: fewer than a held key repeats
_TRIED = 1.0  #: [s] for each key of a layout
_CHANGED = 1e-6  #: [m/s²] or [rad]


def prepare() -> None:
    """Make all that a program may import, before its process is confined."""
    find_module('rclpy')


class RelayProgram:
    """A file with a node that turns `cmd_vel` into `ecu`: of ROS 2, or the lab's for ROS 1."""

    def __init__(self, folder: Folder, path: Path, ros: str) -> None:
        """Run the file at `path`, of `rclpy` or `rospy`."""
        self._folder, self.path, self.ros = folder, path, ros
        self._budget = Budget(_BUDGET) if folder.budget else None
        self._live: LiveRelay | None = None

    def commands(self, twists: Sequence[Sequence[float]], duration: float) -> list[Command]:
        """Return what it publishes on `ecu` from 0 to `duration` [s], while it gets `twists`."""
        world = RelayWorld(twists, duration, self.layout)
        self._simulate(world, is_judged=True)
        return [self.checked(*command) for command in world.commands]

    @cached_property
    def layout(self) -> str:
        """The keys that it reads, a name in `LAYOUTS`; empty where it reads none."""
        first = RelayWorld((), _TRIED)
        self._simulate(first)
        if first.listens_to(_TWIST) or not (first.terminal.use or first.listens_to(_KEY)):
            return ''
        answers = {name: self._answers(name) for name in LAYOUTS}
        best = max(LAYOUTS, key=lambda name: answers[name])
        if not answers[best]:
            keys = '; '.join(LAYOUTS)
            raise UserCodeError(
                f'{self.path.name}: none of these keys changes what it publishes on ecu: {keys}; '
                f'{BY_EYE}'
            )
        return best

    def _answers(self, layout: str) -> int:
        """Return how many of the four keys of a layout change what it commands."""
        keys = LAYOUTS[layout]
        world = RelayWorld((), _TRIED * (len(keys) + 1), layout)
        presses = [_TRIED * (0.5 + k) for k in range(len(keys))]
        for key, t in zip(keys, presses, strict=True):
            world.at(t, partial(world.press, key))
            world.at(t + _TRIED / 2.0, partial(world.press, STOP))
        try:
            self._simulate(world)
        except UserCodeError:
            return 0
        commands, count = [(0.0, 0.0, 0.0), *world.commands], 0
        for k, t in enumerate(presses):
            field = 1 if k < len(keys) // 2 else 2
            before = [each for each in commands if each[0] < t][-1][field]
            after = [each[field] for each in commands if t <= each[0] < t + _TRIED / 2.0]
            count += any(abs(value - before) > _CHANGED for value in after)
        return count

    def _simulate(self, world: RelayWorld, *, is_judged: bool = False) -> None:
        """Run the program in `world`; where it reads keys itself, what fails is judged by eye."""
        try:
            if self._budget:
                self._budget.call(self.run, world)
            else:
                self.run(world)
            if is_judged:
                self._check(world)
        except OutOfTime as error:
            raise UserCodeError(
                f'{self._place(error)}: {world.end / SECOND:g} s of the relay took longer than '
                f'{_BUDGET:g} s: is there an endless loop?'
            ) from error
        except UserCodeError as error:
            if world.terminal.use:
                raise UserCodeError(f'{error}; it {world.terminal.use}: {BY_EYE}') from error
            raise

    def start(self) -> LiveRelay:
        """Start it, to be driven by hand; one that was started before ends."""
        self.stop()
        self._live = LiveRelay(self)
        return self._live

    def stop(self) -> None:
        """End the program that was started, if any."""
        if self._live:
            self._live.stop()

    def run(self, world: RelayWorld) -> None:
        """Run the program in `world`, to its end or the world's."""
        folder = self._folder.again()
        folder.stand_in = world.modules(ros_1=self.ros == 'rospy')
        read_line = world.terminal.readline
        folder.builtins |= dict.fromkeys(('input', 'raw_input'), lambda *_: read_line().strip('\n'))

        def program() -> None:
            module = folder.load(self.path, '__main__')
            if callable(getattr(module, 'main', None)) and not world.has_nodes():
                module.main()

        try:
            world.run(program)
        except (UserCodeError, OutOfTime):
            raise
        except AbsentModuleError as error:
            raise UserCodeError(f'{self._place(error, folder)}: the relay uses {error}') from error
        except Exception as error:
            raise UserCodeError(
                f'{self._place(error, folder)}: after {world.seconds:.2f} s the relay '
                f'raised {describe_error(error)}'
            ) from error

    def _place(self, error: BaseException, folder: Folder | None = None) -> str:
        return raised_at(folder or self._folder, error) or self.path.name

    def _check(self, world: RelayWorld) -> None:
        fault = ''
        if len(world.commands) > MAX_COMMANDS:
            fault = (
                f'it publishes more than {MAX_COMMANDS} commands in {world.seconds:g} s: is the '
                'sleep of its loop missing?'
            )
        elif not (world.commands or world.now_ns):
            fault = 'it ends at once, and publishes nothing on ecu: is its spin missing?'
        elif not world.commands:
            others = ', '.join(map(repr, sorted(world.published)))
            but = f', but on {others}' if others else ''
            fault = (
                f'it publishes nothing on ecu{but}; expected commands of the type ECU on the '
                'topic ecu'
            )
        elif not (world.layout or world.listens_to(_TWIST)):
            topics = ', '.join(map(repr, sorted(world.subscribed))) or 'no topic'
            fault = (
                f"it subscribes to {topics}; expected cmd_vel, the topic of the keyboard's Twists"
            )
        if fault:
            raise UserCodeError(f'{self.path.name}: {fault}')

    def checked(self, t: float, motor: float, servo: float) -> Command:
        """Return a command, which must be finite."""
        if not (isfinite(motor) and isfinite(servo)):
            raise UserCodeError(
                f'{self.path.name}: after {t:.2f} s it published motor {motor!r} and servo '
                f'{servo!r}; expected two finite numbers'
            )
        return Command(t, motor, servo)


class RelayWorld(World):
    """The driver and the car around a program, from time 0 to `end` [s].

    Its topics have no namespaces: the lab's keyboard has `turtle1/cmd_vel`.
    """

    tap = _TAP  #: [s] between two presses of a key that is held

    def __init__(self, twists: Sequence[Sequence[float]], end: float, layout: str = '') -> None:
        super().__init__(simulated=True)
        self.layout, self.terminal = layout, Terminal(self)
        self._held, self._pressed = '', 0.0
        self._publishers: dict[str, Any] = {}  # of the driver, by topic
        self.end, self.flat_names, self.is_silent = end * SECOND, _TOPICS, True
        self.commands: list[tuple[float, float, float]] = []  #: t [s], motor and servo
        self.published: set[str] = set()  #: the program's topics
        self.subscribed: dict[str, str] = {}  #: their types
        self._speed = self._distance = self._motor = self._moved = 0.0
        state, ecu = map(message_type, ('barc_interfaces/msg/ZDynBkMdl', 'barc_interfaces/msg/ECU'))
        with in_world(self):
            init(args=[])
            self.node = Node('car', enable_rosout=False)
            self._state, self._state_pub = (
                state(),
                self.node.create_publisher(state, _STATE, _ALL),
            )
            self.node.create_subscription(ecu, _ECU, self._on_command, _ALL)
            for t, linear_x, angular_z in twists:
                self.at(t, partial(self.drive, linear_x, angular_z))
            self._publish_state()
            self.node.create_timer(_STATE_PERIOD, self._publish_state)
            self._executor = Executor()
            self._executor.add_node(self.node)
            shutdown()  # the program begins by itself
        self.around.append(self._executor)

    def at(self, t: float, call: Callable[[], object]) -> None:
        """Call at the time `t` [s]."""

        def once() -> None:
            timer.cancel()
            call()

        timer = self.node.create_timer(t, once)

    def drive(self, linear_x: float, angular_z: float) -> None:
        """Publish a Twist, and press its key where the program reads keys."""
        message = message_type(_TWIST)()
        message.linear.x, message.angular.z = float(linear_x), float(angular_z)
        self._publish(message, '')
        if not self.layout:
            return
        up, down, left, right = LAYOUTS[self.layout]
        sideways = (left if angular_z > 0.0 else right) if angular_z else ''
        key = (up if linear_x > 0.0 else down) if linear_x else sideways
        if key != self._held or (key and self.seconds - self._pressed >= self.tap - _CHANGED):
            self.press(key or STOP)
        self._held = key

    def press(self, key: str) -> None:
        """Type a key, and publish that it goes down, after the one before has gone up."""
        self._pressed = self.seconds
        self.terminal.type(key)
        for name, word in ((self._held, 'up'), (key, 'down')):
            if name and self.listens_to(_KEY):
                message = message_type(_KEY)()
                message.code = CODES.get(name, ord(name[0]))
                self._publish(message, word)

    def _publish(self, message: Any, word: str) -> None:  # noqa: ANN401 (any message)
        """Publish on each topic of this type that the program listens to, and has `word` in it."""
        for topic in self.listens_to(message.__msgtype__):
            if word in topic:
                made = self._publishers.get(topic)
                made = made or self.node.create_publisher(type(message), f'/{topic}', _ALL)
                self._publishers[topic] = made
                made.publish(message)

    def listens_to(self, kind: str) -> set[str]:
        """Return the topics of messages of a type that the program listens to."""
        self._note_topics()
        return {topic for topic, its_kind in self.subscribed.items() if its_kind == kind}

    def _on_command(self, command: Any) -> None:  # noqa: ANN401 (an ECU)
        self._move()
        self._motor = command.motor if isfinite(command.motor) else 0.0
        self.commands.append((self.seconds, command.motor, command.servo))

    def _move(self) -> None:
        now = self.seconds
        self._distance += self._speed * (now - self._moved)
        self._speed += self._motor * (now - self._moved)
        self._moved = now

    def _publish_state(self) -> None:
        self._note_topics()
        self._move()
        self._state.x, self._state.v_x = self._distance, self._speed
        self._state_pub.publish(self._state)

    def _note_topics(self) -> None:
        """Note the topics of the program's nodes."""
        for node in self.nodes:
            if node is not self.node:
                self.published |= {each.topic_name.strip('/') for each in node.publishers}
                self.subscribed |= {
                    each.topic_name.strip('/'): each.kind.__msgtype__ for each in node.subscriptions
                }

    @property
    def seconds(self) -> float:
        """The time [s]."""
        return self.now_ns / SECOND

    def has_nodes(self) -> bool:
        """Return whether the program has made a node."""
        return len(self.nodes) > 1

    def modules(self, *, ros_1: bool) -> Callable[[str], Any]:
        """Return what gives the modules that take the places of a program's, by name."""
        clock = {
            **dict.fromkeys(('time', 'monotonic', 'perf_counter'), lambda: self.seconds),
            **dict.fromkeys(('time_ns', 'monotonic_ns'), lambda: self.now_ns),
            'sleep': lambda seconds: self.sleep(round(max(float(seconds), 0.0) * SECOND)),
        }
        found = {'time': SimpleNamespace(**vars(time) | clock), **self.terminal.modules()}
        if ros_1:
            with in_world(self):
                found |= rospy_modules(self)
        return lambda name: found.get(name) or self.terminal.elsewhere(name) or find_module(name)

    def run(self, program: Callable[[], object]) -> None:
        """Run a program to its end, or to that of its time."""
        try:
            with in_world(self):
                program()
        except (EndOfTimeError, SystemExit):
            pass
        self._note_topics()
        self.published -= {'rosout', 'parameter_events', _ECU}
        while self._executor.next_due() == self.now_ns:
            self._executor.turn(self.now_ns)


class LiveRelay(RelayWorld):
    """A program in a thread of its own, which runs only while a call waits for it."""

    tap = 0.0  # as a terminal repeats it

    def __init__(self, program: RelayProgram) -> None:
        super().__init__((), 0.0, program.layout)
        self._program = program
        self._failure, self._is_over = '', False
        self._continues, self._waits = threading.Semaphore(0), threading.Semaphore(0)
        self._thread = threading.Thread(target=self._run, name='relay', daemon=True)
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
        _, motor, servo = self._program.checked(*self.commands[-1])
        return motor, servo

    def at_end(self) -> None:
        """Wait for the next call."""
        self._waits.release()
        self._continues.acquire()
        if self._is_over:
            raise EndOfTimeError

    def stop(self) -> None:
        """End the program; a program in the middle of its file holds the imports of others."""
        self._is_over = True
        self._continues.release()
        self._thread.join(_PATIENCE)

    def _run(self) -> None:
        try:
            self._program.run(self)
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
