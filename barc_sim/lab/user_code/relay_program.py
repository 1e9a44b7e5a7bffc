"""A relay that is a whole program of ROS, run without ROS in simulated time.

Around it are a driver and a car. A UserCodeError names what is wrong with it: it fails, has ended,
does not use `cmd_vel` and `ecu`, takes too long, or publishes a number that is not finite.
"""

from __future__ import annotations

import ast
import threading
import time
from math import isfinite
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from barc_sim.lab.user_code import rospy
from barc_sim.lab.user_code.calls import (
    MAX_COMMANDS,
    Budget,
    Command,
    OutOfTime,
    describe_error,
    raised_at,
)
from barc_sim.lab.user_code.importing import AbsentModuleError
from barc_sim.lab.user_code.source import UserCodeError
from barc_sim.ros.local import find_module
from barc_sim.ros.local import world as in_world
from barc_sim.ros.local.context import Context, HistoryPolicy, QoSProfile
from barc_sim.ros.local.executor import SECOND, EndOfTimeError, Executor, World
from barc_sim.ros.local.messages import message_type
from barc_sim.ros.local.node import Node

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from barc_sim.lab.user_code.importing import Folder

_BUDGET = 10.0  #: [s] of a run; it takes some milliseconds
_PATIENCE = 5.0  #: [s] for a program to wait again, while it drives
_STATE_PERIOD = 0.02  #: [s]
_CMD_VEL, _STATE, _ECU = _TOPICS = 'cmd_vel', 'z_vhcl', 'ecu'
_ALL = QoSProfile(history=HistoryPolicy.KEEP_ALL)


def prepare() -> None:
    """Make all that a program may import, before its process is confined."""
    find_module('rclpy')


class RelayProgram:
    """A file with a node that turns `cmd_vel` into `ecu`: of ROS 2, or the lab's for ROS 1."""

    def __init__(self, folder: Folder, path: Path, ros: str, budget: float | None) -> None:
        """Run the file at `path`, of `rclpy` or `rospy`; without `budget` it has no time limit."""
        self._folder, self.path, self.ros = folder, path, ros
        self._budget = Budget(_BUDGET) if budget else None

    def commands(self, twists: Sequence[Sequence[float]], duration: float) -> list[Command]:
        """Return what it publishes on `ecu` from 0 to `duration` [s], while it gets `twists`."""
        world = RelayWorld(twists, duration)
        if self._budget:
            try:
                self._budget.call(self.run, world)
            except OutOfTime as error:
                raise UserCodeError(
                    f'{self._place(error)}: {duration:g} s of the relay took longer than '
                    f'{_BUDGET:g} s: is there an endless loop?'
                ) from error
        else:
            self.run(world)
        self._check(world)
        return [self.checked(*command) for command in world.commands]

    def start(self) -> LiveRelay:
        """Start it, to be driven by hand."""
        return LiveRelay(self)

    def run(self, world: RelayWorld) -> None:
        """Run the program in `world`, to its end or the world's."""
        folder = self._folder.again()
        folder.stand_ins = world.modules(ros_1=self.ros == 'rospy')

        def program() -> None:
            module = folder.load(self.path)
            tree = folder.trees[str(self.path)]
            guarded = [node for node in tree.body if isinstance(node, ast.If) and _is_main(node)]
            for node in guarded:
                body = ast.Module(node.body, type_ignores=[])
                exec(compile(body, str(self.path), 'exec'), vars(module))  # noqa: S102
            if not guarded and callable(getattr(module, 'main', None)) and not world.has_nodes():
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
        elif not world.commands:
            others = ', '.join(map(repr, sorted(world.published)))
            but = f', but on {others}' if others else ''
            fault = (
                f'it publishes nothing on ecu{but}; expected commands of the type ECU on the '
                'topic ecu'
            )
        elif _CMD_VEL not in world.subscribed:
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


def _is_main(node: ast.If) -> bool:
    return '__main__' in ast.unparse(node.test)


class _Modules(dict[str, Any]):
    """The modules of a program: those here, and what stands in for ROS 2."""

    def get(self, name: str, default: Any = None) -> Any:  # noqa: ANN401 (a module)
        return self[name] if name in self else find_module(name) or default


class RelayWorld(World):
    """The driver and the car around a program, from time 0 to `end` [s].

    Its topics have no namespaces: the lab's keyboard has `turtle1/cmd_vel`.
    """

    def __init__(self, twists: Sequence[Sequence[float]], end: float) -> None:
        super().__init__(simulated=True)
        self.end, self.flat_names, self.is_silent = end * SECOND, _TOPICS, True
        self.commands: list[tuple[float, float, float]] = []  #: t [s], motor and servo
        self.published: set[str] = set()  #: the program's topics
        self.subscribed: set[str] = set()
        self._speed = self._distance = self._motor = self._moved = 0.0
        self._twist, state, ecu = map(
            message_type,
            ('geometry_msgs/msg/Twist', 'barc_interfaces/msg/ZDynBkMdl', 'barc_interfaces/msg/ECU'),
        )
        with in_world(self):
            context = Context()
            context.init([])
            self.node = Node('car', context=context, enable_rosout=False)
            self._twist_pub = self.node.create_publisher(self._twist, _CMD_VEL, _ALL)
            self._state, self._state_pub = (
                state(),
                self.node.create_publisher(state, _STATE, _ALL),
            )
            self.node.create_subscription(ecu, _ECU, self._on_command, _ALL)
            for t, linear_x, angular_z in twists:
                self._drive_at(t, linear_x, angular_z)
            self._publish_state()
            self.node.create_timer(_STATE_PERIOD, self._publish_state)
            self._executor = Executor(context=context)
            self._executor.add_node(self.node)
        self.around.append(self._executor)

    def _drive_at(self, t: float, linear_x: float, angular_z: float) -> None:
        def publish() -> None:
            timer.cancel()
            self.drive(linear_x, angular_z)

        timer = self.node.create_timer(t, publish)

    def drive(self, linear_x: float, angular_z: float) -> None:
        """Publish a Twist."""
        message = self._twist()
        message.linear.x, message.angular.z = float(linear_x), float(angular_z)
        self._twist_pub.publish(message)

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
                self.subscribed |= {each.topic_name.strip('/') for each in node.subscriptions}

    @property
    def seconds(self) -> float:
        """The time [s]."""
        return self.now_ns / SECOND

    def has_nodes(self) -> bool:
        """Return whether the program has made a node."""
        return len(self.nodes) > 1

    def modules(self, *, ros_1: bool) -> dict[str, Any]:
        """Return the modules of a program, which replace those of their names."""
        clock = {
            **dict.fromkeys(('time', 'monotonic', 'perf_counter'), lambda: self.seconds),
            **dict.fromkeys(('time_ns', 'monotonic_ns'), lambda: self.now_ns),
            'sleep': lambda seconds: self.sleep(round(max(float(seconds), 0.0) * SECOND)),
        }
        found = _Modules(time=SimpleNamespace(**vars(time) | clock))
        if ros_1:
            with in_world(self):
                found.update(rospy.modules(self))
        return found

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

    def __init__(self, program: RelayProgram) -> None:
        super().__init__((), 0.0)
        self._program = program
        self._failure = ''
        self._continues, self._waits = threading.Semaphore(0), threading.Semaphore(0)
        threading.Thread(target=self._run, name='relay', daemon=True).start()
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
                f'{_PATIENCE:g} s: is there an endless loop?'
            )
        if self._failure:
            raise UserCodeError(self._failure)
