"""Loads a user's files of any lab (see `FILES`) or a policy without a build, and calls them.

This module runs in the process of a submission, so it must not import barc_sim's own laws.
"""

from __future__ import annotations

import builtins
import io
import json
import os
import pathlib
import random
import sys
from bisect import bisect_right
from hashlib import sha256
from inspect import Parameter
from math import inf, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.errors import UserError
from barc_sim.lab.files import (
    CALLED,
    FILES,
    GAINS,
    ChosenGains,
    ErrorKind,
    Source,
    UserCodeError,
    find_gains,
    key_reader,
    main_names,
    ros_of_program,
)
from barc_sim.lab.user_code.folder import (
    BUDGET,
    BY_EYE,
    MAX_PHRASES,
    SECOND,
    Folder,
    OutOfTime,
    TimedCommand,
    UserFunction,
    clock,
    guarded,
    number,
    short_repr,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from types import FrameType, ModuleType

    from typing_extensions import Self

    from barc_sim.lab.user_code.relay_program import RelayProgram
    from barc_sim.lab.user_code.travel import SentCode

    Relay = Callable[..., Sequence[float]]  #: (linear_x, angular_z, dt=…) gives motor and servo

#: Prefix of the names of user files among the attachments of a bag.
_ATTACHED = 'student/'
MAX_LINES = 5000  #: assigned values that `UserCode.lines` collects
MAX_PLACE = 100  #: characters of a file and its line, where the grader asks for it
MAX_NAME = 200  #: characters of the `NAME` in `identify.py`
#: [s] Time budget to load a file: it might import SciPy.
_LOADING = 20.0
_PERIOD = SECOND // 50  #: [ns] between two calls of an object that is judged


class UserCode:
    """A user's files by part, such as model and controller, each loaded when it is first used.

    A missing function, a failing call and a call that takes too long raise a UserCodeError. A file
    that cannot be loaded raises the same one each time.
    """

    def __init__(
        self,
        files: Mapping[str, Path] | None = None,
        *,
        is_judged: bool = False,
        budget: float = BUDGET,
        output: Callable[[str], object] | None = None,
    ) -> None:
        """Use `files` by part (see `FILES`), of any folders.

        `budget` is the time limit of each call [s], which a thread watches. The code `is_judged` in
        the process of a submission, as in `check` and `grade`: an alarm of this process replaces
        the thread, NumPy alone can be imported, and random numbers are seeded. Text that user code
        prints goes to `output`; without it, to stdout.
        """
        # Absolute and without `..`, so that each folder has one name.
        self.paths = {part: Path(os.path.abspath(file)) for part, file in (files or {}).items()}  # noqa: PTH100
        self._folders = {
            path.parent: Folder(path.parent, output, is_judged=is_judged, budget=budget)
            for path in self.paths.values()
        }
        for part, path in self.paths.items():
            name = FILES.get(part, path.name)
            if path.name != name:
                phrase = f'{path.name} is taken as {name}: did you mean that name?'
                self._folders[path.parent].tolerate(phrase)

        self._is_judged = is_judged
        self._budget = budget
        self._requests = 0
        self._objects: dict[int, Callable[..., float]] = {}  # their steps, by the number of `make`
        self._now = 1000 * SECOND  # [ns] on the clock of an object that is judged
        self._loaded: dict[str, Any] = {}  # by part: a UserFunction or a RelayProgram
        self._sent: SentCode | None = None  # the files that travel, once they have

    def __reduce__(self) -> tuple[Callable[[SentCode], UserCode], tuple[SentCode]]:
        """Travel to another process with the bytes of the files; there its printed text is dropped.

        The files are loaded there when they are first used.
        """
        if self._sent is None:
            self._sent = self._files_to_send()
        return _arrived, (self._sent,)

    def _files_to_send(self) -> SentCode:
        """Return the files of all parts, and those that they import; other files stay here."""
        from barc_sim.lab.user_code.travel import (  # noqa: PLC0415 (no submission needs it)
            SentCode,
            SentPart,
            needed_files,
        )

        numbers = {path: number for number, path in enumerate(self._folders)}
        parts = [
            SentPart(part, numbers[path.parent], path.name) for part, path in self.paths.items()
        ]
        folders = []
        for place, folder in self._folders.items():
            paths = [path for path in self.paths.values() if path.parent == place]
            folders.append(needed_files(folder, paths))
        return SentCode(tuple(folders), tuple(parts), self._budget)

    def load(self) -> Self:
        """Load all parts now; return this object."""
        for part in self.paths:
            self._part(part)
        return self

    def drop_writes(self) -> None:
        """Discard all that this process writes to files."""
        for folder in self._folders.values():
            folder.builtins['open'] = folder.open
            builtins.open = folder.open
            io.open = folder.open
            accessor = getattr(pathlib, '_NormalAccessor', None)  # of Python 3.10
            if accessor:
                accessor.open = staticmethod(folder.open)

    #: The user's `bikeFE`; it also gets `l_f`, `l_r` and `g` if it takes them.
    model = property(lambda self: self._part('model'))
    #: The user's class `PID`; it also gets `output_min` and `output_max` if it takes them.
    controller = property(lambda self: self._part('controller'))
    #: The user's class `Lane`; the arguments of its constructor with numbers are its gains.
    lane = property(lambda self: self._part('lane'))
    #: The user's function `command` of the time.
    identify = property(lambda self: self._part('identify'))
    #: The user's function `line` of the points of a track.
    raceline = property(lambda self: self._part('raceline'))
    #: The user's function `relay`, class `Relay`, or whole ROS program.
    relay = property(lambda self: self._part('relay'))

    def _part(self, part: str) -> Any:  # noqa: ANN401 (see `_loaded`)
        if part in self.paths and part not in self._loaded:
            program = self._program() if part == 'relay' else None
            self._loaded[part] = program or self.function(*main_names(part))
        return self._loaded.get(part)

    def _program(self) -> RelayProgram | None:
        """Return the relay as a program, if its file is a whole ROS program."""
        path = self.paths['relay']
        folder = self._folders[path.parent]
        ros = ros_of_program(folder.parse(path))
        if not ros:
            return None

        module = key_reader(folder.parse(path))
        if module:
            raise UserCodeError(
                f'{path.name} reads keys itself, with {module}; expected a relay that gets Twists '
                f'on cmd_vel: {BY_EYE}',
                ErrorKind.READS_KEYS,
            )
        from barc_sim.lab.user_code.relay_program import RelayProgram  # noqa: PLC0415 (200 ms)

        if ros == 'rospy':
            folder.tolerate(f'{path.name} is a ROS 1 program: it runs here without ROS')
        return RelayProgram(folder, path, ros)

    def function(self, *names: str, fresh: bool = False) -> UserFunction:
        """Return the first of these functions or classes that its file defines.

        With `fresh`, the file is loaded again, so that global variables have their first values.
        """
        part = CALLED[names[0]].part
        path = self.paths[part]
        folder = self._folders[path.parent]
        if fresh:
            self._part(part)  # raises the error of its first loading again
            folder = folder.again()
            stand_ins = {'time': clock(lambda: self._now, self._sleep)}
            folder.stand_in = stand_ins.get
        if path not in folder.failed:
            self._seed()
        module = _load(folder, path)

        name = next((each for each in names if hasattr(module, each)), '')
        if not name:
            raise UserCodeError(f'{path.name} defines no {" nor ".join(reversed(names))}')
        value = getattr(module, name)
        called = CALLED[name]
        kind = 'class' if called.method else 'function'
        is_right_kind = isinstance(value, type) if called.method else callable(value)
        if not is_right_kind:
            raise UserCodeError(f'{path.name}: {name} is {short_repr(value)}; expected a {kind}')

        function = UserFunction(folder, value, called)
        if called.method and not callable(guarded(getattr, value, called.method, default=None)):
            arguments = ', '.join(('self', *(CALLED[called.method].takes or '').split()))
            raise UserCodeError(
                f'{function.place()}: the class {name} has no method {called.method}({arguments})'
            )
        if called.takes is None:
            gains_of(function)
        return function

    def _seed(self) -> None:
        """Seed the random numbers of user code, where it is judged: the same file, the same score.

        Each request has another seed, so that a result by chance differs.
        """
        if self._is_judged:
            self._requests += 1
            random.seed(self._requests)
            np.random.seed(self._requests)  # noqa: NPY002 (the one that user code uses)

    def new(self, part: str, *args: float, fresh: bool = False, **options: float) -> UserObject:
        """Return a new object of the class of a part; for `fresh` see `function`."""
        new = self.function(*main_names(part), fresh=True) if fresh else self._part(part)
        name = new.called.method
        instance = new(*args, **options)
        method = guarded(getattr, instance, name, default=None)
        return UserObject(instance, UserFunction(new.folder, method, CALLED[name]))

    def new_pid(self, *gains: float, fresh: bool = False, **limits: float) -> UserObject:
        """Return a new object of the class `PID`; pass the gains by name if it has the names."""
        if {*GAINS} <= {*self._part('controller').parameters}:
            by_name = dict(zip(GAINS, gains, strict=True))
            return self.new('controller', fresh=fresh, **by_name, **limits)
        return self.new('controller', *gains, fresh=fresh, **limits)

    def new_relay(self) -> Relay:
        """Return a new relay; it is called with a Twist, and `dt`, the time since the last call."""
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
    ) -> Sequence[TimedCommand]:
        """Return the commands of a relay: a program gets `twists`, a function these `calls`."""
        if not isinstance(self.relay, UserFunction):
            commands: Sequence[TimedCommand] = self.relay.commands(twists, duration)
            return commands
        relay = self.new_relay()
        dt = calls[1][0] - calls[0][0]
        return [TimedCommand(t, *relay(x, z, dt=dt)) for t, x, z in calls]

    @property
    def gains(self) -> ChosenGains | None:
        """The gains that `controller.py` chooses; None if it is not loaded, or chooses none."""
        new = self._loaded.get('controller')
        if new is None:
            return None
        path = str(self.paths['controller'])
        name = new.folder.sources[path].name
        return find_gains(new.folder.trees[path], name, new.signature, new.place())

    @property
    def name(self) -> str:
        """The first characters of the `NAME` in `identify.py`; empty if it has none."""
        if not self.identify:
            return ''
        module = self.identify.folder.load(self.paths['identify'])
        return guarded(lambda: str(getattr(module, 'NAME', ''))[:MAX_NAME], default='')

    @property
    def tolerated(self) -> tuple[str, ...]:
        """The faults of the loaded files that cost nothing, a phrase each."""
        return tuple(phrase for folder in self._folders.values() for phrase in folder.tolerated)

    @property
    def sources(self) -> list[Source]:
        """The loaded files, and the files of their folders that they import."""
        return [each for folder in self._folders.values() for each in folder.sources.values()]

    def describe(self) -> dict[str, str]:
        """Return an entry of a bag's metadata: files by part, and their hashes."""
        loaded = {source.path: source.name for source in self.sources}
        files = {part: loaded[path] for part, path in self.paths.items() if path in loaded}
        hashes = {source.name: sha256(source.data).hexdigest() for source in self.sources}
        if not hashes:
            return {}
        return {'student_code': json.dumps({'files': files, 'sha256': hashes})}

    def attachments(self) -> dict[str, bytes]:
        """Return the user's files, by their names as attachments of a bag."""
        return {_ATTACHED + source.name: source.data for source in self.sources}

    # Requests of the grader to the process of a submission, beside `relay_commands` and `name`;
    # `confined/child.py` has the table of all.

    def functions(
        self,
        name: str,
        rows: Sequence[Sequence[float]],
        fresh: bool = False,
        corrected: tuple[str, Sequence[Any], Sequence[Any]] | None = None,
    ) -> list[list[float]]:
        """Return the result of a function for each row of arguments; for `fresh` see `function`.

        `corrected` has the name of another function of its file, arguments, and the right results
        for them: while the function is called, the other one returns these.
        """
        # A fresh module, because its names are replaced.
        function = self.function(name, fresh=fresh or corrected is not None)
        if corrected:
            module = function.folder.load(self.paths[function.called.part])
            _replace_results(module, *corrected)
        return [function(*row) for row in rows]

    def make(self, name: str, number: int, *arguments: Any) -> None:  # noqa: ANN401 (JSON)
        """Make a `PID` or `Lane` with this number; its file is loaded again.

        The arguments are the gains of a PID, which gets no limits, or the track of a Lane: the
        segments' ends and curvatures.
        """
        if name == 'PID':
            limits = {'output_min': -inf, 'output_max': inf}
            self._objects[number] = self.new_pid(*arguments, fresh=True, **limits).acc_calculate
            return

        ends, curvatures = arguments
        lane = self.new('lane', fresh=True)

        def steer(e_y: float, e_psi: float, speed: float, place: float) -> float:
            def curvature(d: float) -> float:
                segment = bisect_right(ends, (place + d) % ends[-1]) % len(ends)
                return float(curvatures[segment])

            curvature.__qualname__ = 'curvature'  # errors show this name
            return float(lane(e_y, e_psi, speed, curvature))

        self._objects[number] = steer

    def steps(self, name: str, number: int, rows: Sequence[Sequence[float]]) -> list[float]:
        """Return the outputs of the object with this number, for the rows of inputs in turn."""
        if number not in self._objects:
            raise UserError(f'{name}: the process of this object has ended')
        outputs = []
        for row in rows:
            self._sleep(_PERIOD)
            outputs.append(self._objects[number](*row))
        return outputs

    def _sleep(self, duration: int) -> None:
        self._now += duration  # [ns]

    def lines(self, do: str, *arguments: Any) -> list[tuple[str, float]]:  # noqa: ANN401 (JSON)
        """Return each line that assigns a number in a request, with the number; returns with NaN.

        It traces local variables and attributes of `self`. Python calls `trace` before a line runs,
        so a new value belongs to the line of the event before. At the start of a function there is
        none: no line assigns the arguments.
        """
        # A new process has loaded no file yet: without this it would know the names of none.
        self._part(CALLED[arguments[0]].part)
        names = {str(source.path): source.name for source in self.sources}
        before: dict[FrameType, tuple[int, dict[str, Any]]] = {}
        assigned: list[tuple[str, float]] = []

        def trace(frame: FrameType, event: str, _: object) -> Callable[..., Any] | None:
            file = names.get(frame.f_code.co_filename)
            if file is None or len(assigned) > MAX_LINES:
                return None

            values = dict(frame.f_locals)
            attributes = getattr(frame.f_locals.get('self'), '__dict__', {})
            values.update({f'self.{name}': value for name, value in attributes.items()})
            line, old = before.get(frame, (0, values))
            for name, value in values.items():
                if isinstance(value, (int, float)) and old.get(name) is not value:
                    assigned.append((f'{file}, line {line}', float(value)))
            if event == 'return':
                assigned.append((f'{file}, line {frame.f_lineno}', nan))
            before[frame] = frame.f_lineno, values
            return trace

        usual = sys.gettrace()
        sys.settrace(trace)
        try:
            getattr(self, do)(*arguments)
        finally:
            sys.settrace(usual)
        return [(place[-MAX_PLACE:], value) for place, value in assigned[:MAX_LINES]]

    def notes(self) -> dict[str, Any]:
        """Return the chosen gains and the first tolerated faults."""
        gains = self.gains
        if gains:
            gains = gains._replace(origin=gains.origin[-MAX_PLACE:])
        return {'gains': gains, 'tolerated': self.tolerated[:MAX_PHRASES]}


def _arrived(sent: SentCode) -> UserCode:
    """Return the user code of files that were sent to this process."""
    from barc_sim.lab.user_code.travel import written  # noqa: PLC0415 (no submission needs it)

    return UserCode(written(sent), budget=sent.budget, output=_drop)


def _drop(_: str) -> None:
    """Drop a printed text."""


class UserObject:
    """An object of a user's class that is called step by step."""

    def __init__(self, instance: Any, step: UserFunction) -> None:  # noqa: ANN401 (a user's)
        """Use `step`, a method of the `instance`."""
        self._instance = instance
        self._step = step

    def __call__(self, *args: Any, **options: Any) -> Any:  # noqa: ANN401 (as its class defines)
        """Return the result of a step."""
        return self._step(*args, **options)

    def acc_calculate(self, speed_reference: float, speed_current: float, dt: float) -> float:
        """Return the acceleration [m/s²] for speeds in m/s, `dt` seconds after the last call."""
        acceleration: float = self._step(speed_reference, speed_current, dt=dt)
        return acceleration

    def read(self, name: str) -> float:
        """Return the object's attribute `name`; NaN if it is not a number."""
        value = number(guarded(getattr, self._instance, name, default=nan))
        return nan if value is None else value

    def set_gains(self, gains: Mapping[str, float]) -> None:
        """Change those gains that the object has as attributes."""
        for name, value in gains.items():
            if guarded(hasattr, self._instance, name, default=False):
                guarded(setattr, self._instance, name, value, default=None)


def _replace_results(
    module: ModuleType,
    name: str,
    rows: Sequence[Sequence[float]],
    results: Sequence[Sequence[float]],
) -> None:
    """Let a function of a user's module return these results for these rows of arguments.

    It is still called, and its results keep their type. Other arguments have its own results.
    """
    function: Any = getattr(module, name, None)
    right = {tuple(row): [*result] for row, result in zip(rows, results, strict=True)}

    def corrected(*args: Any, **options: Any) -> Any:  # noqa: ANN401 (a user's)
        result = function(*args, **options)
        values = guarded(right.get, (*args, *options.values()), default=None)
        return result if values is None else _like(result, values)

    for each, value in [*vars(module).items()]:
        if callable(function) and value is function:
            setattr(module, each, corrected)


def _like(result: Any, values: list[float]) -> Any:  # noqa: ANN401 (a user's)
    """Return `values` as the type of a user's result: a list, a tuple or an array."""
    if isinstance(result, tuple):
        return tuple(values)
    if not hasattr(result, 'astype'):
        return values
    array = result.astype(float)
    array.flat = values
    return array


def gains_of(lane: UserFunction) -> dict[str, float]:
    """Return the gains of a user's class `Lane`: its arguments whose defaults are numbers.

    All others keep their defaults. An argument without a default raises a UserCodeError.
    """
    gains = {}
    for name, parameter in lane.signature.parameters.items():
        if parameter.kind in {Parameter.VAR_POSITIONAL, Parameter.VAR_KEYWORD}:
            continue
        if parameter.default is Parameter.empty:
            raise UserCodeError(
                f'{lane.place()}: Lane takes ({", ".join(lane.signature.parameters)}), and a run '
                f'passes none: expected a default for each, as in {name}=0.2'
            )
        value = None if isinstance(parameter.default, bool) else number(parameter.default)
        if value is not None:
            gains[name] = value
    return gains


def _load(folder: Folder, path: Path) -> ModuleType:
    """Return the module of a file; a UserCodeError, the same each time, if it cannot be loaded."""
    if path in folder.failed:
        raise folder.failed[path]
    try:
        return folder.time_budget(_LOADING).call(folder.load, path)
    except UserError:
        raise
    except (Exception, SystemExit, OutOfTime) as error:
        fault = f'loading the file raised {folder.describe(error)}'
        kind = ErrorKind.OTHER
        if isinstance(error, ModuleNotFoundError):
            fault = (
                f'there is no module {error.name!r} here: install it, put it into the folder, '
                'or do without it'
            )
        elif isinstance(error, OutOfTime):
            fault = (
                f'loading the file took longer than {error.seconds or _LOADING:g} s: is there an '
                'endless loop outside its functions?'
            )
            kind = ErrorKind.ENDLESS
        failure = UserCodeError(f'{folder.raised_at(error)[0] or path.name}: {fault}', kind)
        folder.failed[path] = failure
        raise failure from error


def attached(attachments: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the user's files among the attachments of a bag, by file name."""
    return {
        name.removeprefix(_ATTACHED): data
        for name, data in attachments.items()
        if name.startswith(_ATTACHED)
    }
