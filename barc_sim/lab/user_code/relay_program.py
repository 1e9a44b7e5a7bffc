"""A relay that is a whole program of ROS, run without ROS in simulated time.

A UserCodeError names what is wrong with it: it fails, has ended, does not use `cmd_vel` and `ecu`,
takes too long, or publishes a number that is not finite.
"""

from __future__ import annotations

import ast
import threading
from math import isfinite
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.lab.user_code.budget import Budget, OutOfTime
from barc_sim.lab.user_code.call import describe_error, raised_at
from barc_sim.lab.user_code.importing import AbsentModuleError
from barc_sim.lab.user_code.source import UserCodeError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from barc_sim.lab.user_code.importing import Folder
    from barc_sim.lab.user_code.relay_world import RelayWorld

ROS_1, ROS_2 = 'rospy', 'rclpy'
MOST_COMMANDS = 8000  #: of a run; a relay has 20 a second
_ARGUMENTS = 2  #: of a function `relay`: linear_x and angular_z
_BUDGET = 10.0  #: [s] of a run; it takes some milliseconds
_PATIENCE = 5.0  #: [s] for a program to wait again, while it drives


class TimedTwist(NamedTuple):
    """A Twist on `cmd_vel`.

    Examples
    --------
    >>> TimedTwist(t=1.0, linear_x=1.0, angular_z=0.0)
    TimedTwist(t=1.0, linear_x=1.0, angular_z=0.0)
    """

    t: float  #: [s]
    linear_x: float
    angular_z: float


class Command(NamedTuple):
    """A command on `ecu`."""

    t: float  #: [s]
    motor: float
    servo: float


def ros_of_program(tree: ast.Module) -> str:
    """Return `rclpy` or `rospy` where a file is a program of it, and empty where it is not.

    A file that defines a function `relay` of two arguments, or a class with such a method, is
    called by the node of barc_sim, also where it imports ROS.

    Examples
    --------
    >>> ros_of_program(ast.parse('import rclpy; rclpy.init()'))
    'rclpy'
    """
    for node in tree.body:
        parts = node.body if isinstance(node, ast.ClassDef) and node.name == 'Relay' else [node]
        for part in parts:
            if isinstance(part, ast.FunctionDef) and part.name == 'relay':
                arguments = [each.arg for each in part.args.args if each.arg != 'self']
                if len(arguments) >= _ARGUMENTS or part.args.vararg:
                    return ''
    imported = {name.partition('.')[0] for node in ast.walk(tree) for name in _imports(node)}
    return next((ros for ros in (ROS_2, ROS_1) if ros in imported), '')


def _imports(node: ast.AST) -> list[str]:
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [node.module or ''] if isinstance(node, ast.ImportFrom) and not node.level else []


class RelayProgram:
    """A file with a node that turns `cmd_vel` into `ecu`: of ROS 2, or the lab's for ROS 1."""

    def __init__(self, folder: Folder, path: Path, ros: str, budget: float | None) -> None:
        """Run the file at `path`, of `rclpy` or `rospy`; without `budget` it has no time limit."""
        self._folder, self.path, self.ros = folder, path, ros
        self._budget = Budget(_BUDGET) if budget else None

    def commands(self, twists: Sequence[TimedTwist], duration: float) -> list[Command]:
        """Return what it publishes on `ecu` from 0 to `duration` [s], while it gets `twists`."""
        from barc_sim.lab.user_code.relay_world import RelayWorld  # noqa: PLC0415 (200 ms)

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

    def run(self, world: RelayWorld) -> None:
        """Run the program in `world`, to its end or the world's."""
        folder = self._folder.again()
        folder.stand_ins = world.modules(ros_1=self.ros == ROS_1)

        def program() -> None:
            module = folder.load(self.path)
            tree = folder.trees[str(self.path.absolute())]
            guarded = [
                node for node in tree.body if isinstance(node, ast.If) and _asks_for_main(node)
            ]
            for node in guarded:
                body = ast.Module(node.body, type_ignores=[])
                exec(compile(body, str(self.path.absolute()), 'exec'), vars(module))  # noqa: S102
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
        if len(world.commands) > MOST_COMMANDS:
            raise UserCodeError(
                f'{self.path.name}: it publishes more than {MOST_COMMANDS} commands in '
                f'{world.seconds:g} s: is the sleep of its loop missing?'
            )
        if world.commands and 'cmd_vel' not in world.subscribed:
            topics = ', '.join(map(repr, sorted(world.subscribed)))
            raise UserCodeError(
                f'{self.path.name}: it subscribes to {topics or "no topic"}; expected cmd_vel, '
                "the topic of the keyboard's Twists"
            )
        if not world.commands:
            others = ', '.join(map(repr, sorted(world.published)))
            raise UserCodeError(
                f'{self.path.name}: it publishes nothing on ecu'
                + (f', but on {others}' if others else '')
                + '; expected commands of the type ECU on the topic ecu'
            )

    def checked(self, t: float, motor: float, servo: float) -> Command:
        """Return a command, which must be finite."""
        if not (isfinite(motor) and isfinite(servo)):
            raise UserCodeError(
                f'{self.path.name}: after {t:.2f} s it published motor {motor!r} and servo '
                f'{servo!r}; expected two finite numbers'
            )
        return Command(t, motor, servo)

    def __call__(self) -> LiveRelay:
        """Start it, to be driven by hand."""
        return LiveRelay(self)


class LiveRelay:
    """A running program of ROS 1, as the object of a class `Relay`."""

    def __init__(self, program: RelayProgram) -> None:
        """Start its thread, which runs only while `relay` waits for it."""
        from barc_sim.lab.user_code.relay_world import LiveWorld  # noqa: PLC0415 (200 ms)

        self._program, self._world = program, LiveWorld()
        self._failure = ''
        threading.Thread(target=self._run, name='relay', daemon=True).start()
        self._wait()

    def _run(self) -> None:
        try:
            self._program.run(self._world)
            self._failure = f'{self._program.path.name}: the program of the relay has ended'
        except UserCodeError as error:
            self._failure = str(error)
        self._world.waits.release()

    def _wait(self) -> None:
        if not self._world.waits.acquire(timeout=_PATIENCE):
            self._failure = (
                f'{self._program.path.name}: the relay did not wait, in a spin or a sleep, within '
                f'{_PATIENCE:g} s: is there an endless loop?'
            )
        if self._failure:
            raise UserCodeError(self._failure)

    def relay(self, linear_x: float, angular_z: float, dt: float) -> tuple[float, float]:
        """Return motor [m/s²] and servo [rad] `dt` seconds after the last call, for a Twist."""
        world = self._world
        world.drive(linear_x, angular_z)
        world.continue_for(dt)
        self._wait()
        if not world.commands:
            return 0.0, 0.0
        del world.commands[:-1]
        _, motor, servo = self._program.checked(*world.commands[-1])
        return motor, servo


def _asks_for_main(node: ast.If) -> bool:
    return '__main__' in ast.unparse(node.test)
