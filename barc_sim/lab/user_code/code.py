"""A user's files of any lab, see `FILES`, and a policy: loaded without a build, and called.

This module runs in the process of a submission: it imports no law of barc_sim.
"""

from __future__ import annotations

import builtins
import io
import json
import os
import sys
from bisect import bisect_right
from hashlib import sha256
from math import inf, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from barc_sim.errors import UserError
from barc_sim.lab.files import (
    FILES,
    GAINS,
    ChosenGains,
    Source,
    UserCodeError,
    find_gains,
    key_reader,
    ros_of_program,
)
from barc_sim.lab.user_code.folder import (
    BUDGET,
    BY_EYE,
    SECOND,
    Budget,
    Called,
    Command,
    Folder,
    OutOfTime,
    UserFunction,
    clock,
    describe_error,
    guarded,
    hint_on,
    number,
    raised_at,
    short_repr,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from types import FrameType, ModuleType

    from typing_extensions import Self

    from barc_sim.lab.user_code.relay_program import RelayProgram

    Relay = Callable[..., Sequence[float]]  #: of linear_x, angular_z and dt=; motor and servo

#: The start of the names of the user's files, as attachments of a bag.
_ATTACHED = 'student/'
_MAX_VALUES = 5000  # of the names in a function
#: [s] Time budget to load a file: it might import SciPy.
_LOADING = 20.0
_PERIOD = SECOND // 50  #: [ns] between two calls of an object that is judged


_ERRORS = 'two finite numbers, [e_y, e_psi]'
POINTS = 120  #: of a track, in `raceline.py`
#: What is called of a user's files.
CALLED = {
    'bikeFE': Called(
        'model',
        'x y psi v a d_f a0 m Ff theta ts',
        4,
        'four finite numbers, [x_next, y_next, psi_next, v_next]',
    ),
    'PID': Called('controller', 'kp ki kd', method='acc_calculate'),
    'acc_calculate': Called(
        'controller',
        'speed_reference speed_current',
        1,
        'a finite number, the acceleration [m/s²]',
        timed=True,
    ),
    'Relay': Called('relay', '', method='relay'),
    'relay': Called(
        'relay', 'linear_x angular_z', 2, 'two finite numbers, [motor, servo]', timed=True
    ),
    'Lane': Called('lane', None, method='steer_calculate'),
    'steer_calculate': Called(
        'lane', 'e_y e_psi speed curvature', 1, 'a finite number, the steering angle [rad]'
    ),
    'straight_errors': Called('lane', 'x y psi x_0 y_0 psi_0', 2, _ERRORS),
    'arc_errors': Called('lane', 'x y psi x_c y_c radius', 2, _ERRORS),
    'steady': Called('lane', 'curvature', 2, 'two finite numbers, [delta, e_psi]'),
    'policy': Called('policy', 'observation', returns='a list of actions'),
    'profile': Called('raceline', 'curvatures step', POINTS, f'{POINTS} finite speeds [m/s]'),
    'line': Called('raceline', 'x y psi half', POINTS, f'{POINTS} finite numbers, offsets [m]'),
    'predict': Called('raceline', 'speed', 6, 'six finite numbers, [a11, a12, a21, a22, b1, b2]'),
    'program': Called('raceline', 'e_y e_psi speed', 110, '110 finite numbers, np.append(H, g)'),
    'command': Called('identify', 't', 1, 'a finite number, the acceleration [m/s²]'),
    'estimate': Called('identify', 't v a', 6, 'six finite numbers, [drag, …, delay_interval]'),
}
#: What a part is loaded for: the first of these that its file defines.
_MAIN = {
    'model': ['bikeFE'],
    'controller': ['PID'],
    'relay': ['Relay', 'relay'],
    'lane': ['Lane'],
    'identify': ['command'],
    'raceline': ['line'],
    'policy': ['policy'],
}


class UserCode:
    """A user's files by part, such as model and controller, each loaded when it is first used.

    What a file lacks, what fails and what takes too long is a UserCodeError; the same one each time
    where a file cannot be loaded.
    """

    def __init__(
        self,
        files: Mapping[str, Path] | None = None,
        *,
        budget: float | None = BUDGET,
        output: Callable[[str], object] | None = None,
    ) -> None:
        """Use `files` by part (see `FILES`), of any folders.

        The `budget` is that of each call [s]; None in the process of a submission, as in `check`
        and `grade`: no thread, and the code can import no package but NumPy. What user code prints
        goes to `output`, or to stdout without it.
        """
        # Without `..`, for the names of folders.
        self.paths = {part: Path(os.path.abspath(file)) for part, file in (files or {}).items()}  # noqa: PTH100
        self._folders = {
            path.parent: Folder(path.parent, output, budget=budget) for path in self.paths.values()
        }
        for part, path in self.paths.items():
            if path.name != (usual := FILES.get(part, path.name)):
                phrase = f'{path.name} is taken as {usual}: did you mean that name?'
                self._folders[path.parent].tolerate(phrase)
        self._made: dict[int, Callable[..., float]] = {}  # by the requests' numbers
        self._now = 1000 * SECOND  # [ns] on the clock of an object that is judged
        self._loaded: dict[str, Any] = {}  # by part: a UserFunction or a RelayProgram

    def load(self) -> Self:
        """Load all parts now; return this object."""
        for part in self.paths:
            self._part(part)
        return self

    def drop_writes(self) -> None:
        """Let all that this process writes to files go nowhere."""
        for folder in self._folders.values():
            builtins.open = io.open = folder.builtins['open'] = folder.open

    #: Their `bikeFE`; it also gets `l_f`, `l_r` and `g` if it takes them.
    model = property(lambda self: self._part('model'))
    #: Their class `PID`; it also gets `output_min` and `output_max` if it takes them.
    controller = property(lambda self: self._part('controller'))
    #: Their class `Lane`; the arguments of its constructor are its gains.
    lane = property(lambda self: self._part('lane'))
    #: Their function `command` of the time.
    identify = property(lambda self: self._part('identify'))
    #: Their function `line`, of the points of a track.
    raceline = property(lambda self: self._part('raceline'))
    #: Their function `relay`, their class `Relay`, or a whole program of ROS.
    relay = property(lambda self: self._part('relay'))

    def _part(self, part: str) -> Any:  # noqa: ANN401 (see `_loaded`)
        if part in self.paths and part not in self._loaded:
            program = self._program() if part == 'relay' else None
            self._loaded[part] = program or self.function(*_MAIN[part])
        return self._loaded.get(part)

    def _program(self) -> RelayProgram | None:
        """Return the relay, if its file is a whole program of ROS."""
        path = self.paths['relay']
        folder = self._folders[path.parent]
        ros = ros_of_program(folder.parse(path))
        if not ros:
            return None
        if module := key_reader(folder.parse(path)):
            raise UserCodeError(
                f'{path.name} reads keys itself, with {module}; expected a relay of the Twists on '
                f'cmd_vel: {BY_EYE}'
            )
        from barc_sim.lab.user_code.relay_program import RelayProgram  # noqa: PLC0415 (200 ms)

        if ros == 'rospy':
            folder.tolerate(f'{path.name}: a program of ROS 1, which runs here without it')
        return RelayProgram(folder, path, ros)

    def function(self, *names: str, fresh: bool = False) -> UserFunction:
        """Return the first of these functions or classes that its file defines.

        With `fresh`, the file is loaded again, so that no global variable has an old value.
        """
        part = CALLED[names[0]].part
        path = self.paths[part]
        folder = self._folders[path.parent]
        if fresh:
            self._part(part)  # raises what its first loading has raised
            folder = folder.again()
            own = {'time': clock(lambda: self._now, self._sleep)}
            folder.stand_in = own.get
        name, value = _defined(folder, path, names)
        called = CALLED[name]
        if not (isinstance(value, type) if called.method else callable(value)):
            expected = 'class' if called.method else 'function'
            raise UserCodeError(
                f'{path.name}: {name} is {short_repr(value)}; expected a {expected}'
            )
        found = UserFunction(folder, value, called)
        if called.method and not callable(guarded(getattr, value, called.method, default=None)):
            arguments = ', '.join(('self', *(CALLED[called.method].takes or '').split()))
            raise UserCodeError(
                f'{found.place()}: the class {name} has no method {called.method}({arguments})'
            )
        if called.takes is None:
            gains_of(found)
        return found

    def new(self, part: str, *args: float, fresh: bool = False, **options: float) -> UserObject:
        """Return a new object of the class of a part.

        With `fresh`, its file is loaded again, so that no global variable has an old value.
        """
        new = self.function(*_MAIN[part], fresh=True) if fresh else self._part(part)
        name = new.called.method
        instance = new(*args, **options)
        method = guarded(getattr, instance, name, default=None)
        return UserObject(instance, UserFunction(new.folder, method, CALLED[name]))

    def new_pid(self, *gains: float, fresh: bool = False, **limits: float) -> UserObject:
        """Return a new object of their class `PID`: kp, ki and kd by name, else by position."""
        if {*GAINS} <= {*self._part('controller').parameters}:
            by_name = dict(zip(GAINS, gains, strict=True))
            return self.new('controller', fresh=fresh, **by_name, **limits)
        return self.new('controller', *gains, fresh=fresh, **limits)

    def new_relay(self) -> Relay:
        """Return a new relay, to be called for a Twist `dt` seconds after the last call."""
        relay: Any = self.relay
        if not isinstance(relay, UserFunction):
            live: Relay = relay.start()
            return live
        return self.new('relay') if relay.called.method else relay

    def relay_commands(
        self,
        twists: Sequence[Sequence[float]],
        duration: float,
        calls: Sequence[Sequence[float]],
    ) -> Sequence[Command]:
        """Return what a relay commands: for `twists` a program, in these `calls` a function."""
        if not isinstance(self.relay, UserFunction):
            commands: Sequence[Command] = self.relay.commands(twists, duration)
            return commands
        relay, dt = self.new_relay(), calls[1][0] - calls[0][0]
        return [Command(t, *relay(x, z, dt=dt)) for t, x, z in calls]

    @property
    def gains(self) -> ChosenGains | None:
        """The gains that `controller.py`, which is loaded, chooses."""
        if (new := self._loaded.get('controller')) is None:
            return None
        path = str(self.paths['controller'])
        name = new.folder.sources[path].name
        return find_gains(new.folder.trees[path], name, new.signature, new.place())

    @property
    def name(self) -> str:
        """The `NAME` in `identify.py`; empty if it has none."""
        if not self.identify:
            return ''
        module = self.identify.folder.load(self.paths['identify'])
        return guarded(lambda: str(getattr(module, 'NAME', '')), default='')

    @property
    def tolerated(self) -> tuple[str, ...]:
        """What was tolerated in the loaded files, a phrase each."""
        return tuple(phrase for folder in self._folders.values() for phrase in folder.tolerated)

    @property
    def sources(self) -> list[Source]:
        """The loaded files, and those that they import from their folders."""
        return [each for folder in self._folders.values() for each in folder.sources.values()]

    def describe(self) -> dict[str, str]:
        """Return the entry of a bag's metadata: files by part, and hashes."""
        loaded = {source.path: source.name for source in self.sources}
        files = {part: loaded[path] for part, path in self.paths.items() if path in loaded}
        hashes = {each.name: sha256(each.text.encode()).hexdigest() for each in self.sources}
        return {'student_code': json.dumps({'files': files, 'sha256': hashes})} if hashes else {}

    def attachments(self) -> dict[str, bytes]:
        """Return the user's files, by their names as attachments of a bag."""
        return {_ATTACHED + source.name: source.text.encode() for source in self.sources}

    # What the grader requests of the process of a submission, beside `relay_commands` and `name`.

    def functions(
        self,
        name: str,
        rows: Sequence[Sequence[float]],
        fresh: bool = False,
    ) -> list[list[float]]:
        """Return the result of a function for each row; with `fresh`, of its file loaded again."""
        function = self.function(name, fresh=fresh)
        return [function(*row) for row in rows]

    def make(self, name: str, number: int, *arguments: Any) -> None:  # noqa: ANN401 (JSON)
        """Make the `PID` or `Lane` of this number; its file is loaded again.

        A PID gets its gains, and no limits; a Lane its track: the segments' ends and curvatures.
        """
        if name == 'PID':
            limits = {'output_min': -inf, 'output_max': inf}
            self._made[number] = self.new_pid(*arguments, fresh=True, **limits).acc_calculate
            return
        lane, (ends, curvatures) = self.new('lane', fresh=True), arguments

        def steer(e_y: float, e_psi: float, speed: float, place: float) -> float:
            def curvature(d: float) -> float:
                return float(curvatures[bisect_right(ends, (place + d) % ends[-1]) % len(ends)])

            curvature.__qualname__ = 'curvature'  # as an error shows it
            return float(lane(e_y, e_psi, speed, curvature))

        self._made[number] = steer

    def steps(self, name: str, number: int, rows: Sequence[Sequence[float]]) -> list[float]:
        """Return the outputs of what was made, for one row of inputs after the other."""
        if number not in self._made:
            raise UserError(f'{name}: the process of this object has ended')
        outputs = []
        for row in rows:
            self._sleep(_PERIOD)
            outputs.append(self._made[number](*row))
        return outputs

    def _sleep(self, duration: int) -> None:
        self._now += duration  # [ns]

    def lines(self, do: str, *arguments: Any) -> list[tuple[str, float]]:  # noqa: ANN401 (JSON)
        """Return the lines that give numbers to names in a request, with these; last, its return.

        Names are local ones, and those of `self`.
        """
        names = {str(source.path): source.name for source in self.sources}
        before: dict[FrameType, tuple[int, dict[str, Any]]] = {}
        found: list[tuple[str, float]] = []

        def trace(frame: FrameType, event: str, _: object) -> Callable[..., Any] | None:
            file = names.get(frame.f_code.co_filename)
            if file is None or len(found) > _MAX_VALUES:
                return None
            own = getattr(frame.f_locals.get('self'), '__dict__', {})
            values = {**frame.f_locals, **{f'self.{name}': value for name, value in own.items()}}
            line, old = before.get(frame, (0, values))
            found.extend(
                (f'{file}, line {line}', float(value))
                for name, value in values.items()
                if isinstance(value, (int, float)) and old.get(name) is not value
            )
            if event == 'return':
                found.append((f'{file}, line {frame.f_lineno}', nan))
            before[frame] = frame.f_lineno, values
            return trace

        usual = sys.gettrace()
        sys.settrace(trace)
        try:
            getattr(self, do)(*arguments)
        finally:
            sys.settrace(usual)
        return found

    def notes(self) -> dict[str, Any]:
        """Return the chosen gains and what was tolerated."""
        return {'gains': self.gains, 'tolerated': self.tolerated}


class UserObject:
    """An object of a user's class that is called step by step."""

    def __init__(self, instance: Any, step: UserFunction) -> None:  # noqa: ANN401 (a user's)
        """Use `step`, a method of the `instance`."""
        self._instance, self._step = instance, step

    def __call__(self, *args: Any, **options: Any) -> Any:  # noqa: ANN401 (as its class defines)
        """Return the result of a step."""
        return self._step(*args, **options)

    def acc_calculate(self, speed_reference: float, speed_current: float, dt: float) -> float:
        """Return the acceleration [m/s²] for speeds in m/s, `dt` seconds after the last call."""
        found: float = self._step(speed_reference, speed_current, dt=dt)
        return found

    def read(self, name: str) -> float:
        """Return the object's attribute `name`; NaN if it is not a number."""
        value = number(guarded(getattr, self._instance, name, default=nan))
        return nan if value is None else value

    def set_gains(self, gains: Mapping[str, float]) -> None:
        """Change those gains that the object has as attributes."""
        for name, value in gains.items():
            if guarded(hasattr, self._instance, name, default=False):
                guarded(setattr, self._instance, name, value, default=None)


def gains_of(lane: UserFunction) -> dict[str, float]:
    """Return the gains of a user's class `Lane`: its arguments, whose defaults must be numbers."""
    gains = {}
    for name, each in lane.signature.parameters.items():
        if (value := number(each.default)) is None:
            raise UserCodeError(
                f'{lane.place()}: Lane takes ({", ".join(lane.signature.parameters)}), and each is '
                f'a gain: expected a number as its default, as in {name}=0.2'
            )
        gains[name] = value
    return gains


def _defined(folder: Folder, path: Path, names: Sequence[str]) -> tuple[str, Any]:
    """Return the first of `names` that the file at `path` defines, and its value."""
    module = _load(folder, path)
    for name in names:
        if hasattr(module, name):
            return name, getattr(module, name)
    raise UserCodeError(f'{path.name} defines no {" nor ".join(reversed(names))}')


def _load(folder: Folder, path: Path) -> ModuleType:
    """Return the module of a file; a UserCodeError names why it cannot be loaded, once tried."""
    if path in folder.failed:
        raise folder.failed[path]
    loading = Budget(_LOADING) if folder.budget else None
    try:
        return loading.call(folder.load, path) if loading else folder.load(path)
    except UserError:
        raise
    except (Exception, SystemExit, OutOfTime) as error:
        hint = hint_on(folder, error)
        fault = f'loading the file raised {describe_error(error)}' + (f': {hint}' if hint else '')
        if isinstance(error, ModuleNotFoundError):
            fault = (
                f'there is no module {error.name!r} here: install it, put it into the folder, '
                'or do without it'
            )
        elif isinstance(error, OutOfTime):
            fault = (
                f'loading the file took longer than {_LOADING if loading else error.seconds:g} '
                's: is there an endless loop outside its functions?'
            )
        found = UserCodeError(f'{raised_at(folder, error) or path.name}: {fault}')
        folder.failed[path] = found
        raise found from error


def attached(found: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the user's files among the attachments of a bag, by their own names."""
    names = {name: name.removeprefix(_ATTACHED) for name in found if name.startswith(_ATTACHED)}
    return {own: found[name] for name, own in names.items()}
