"""A user's `bike_model.py`, `controller.py`, `relay.py` and `lane.py`, loaded without a build.

This module runs in the process of a submission: it imports no law of barc_sim.
"""

from __future__ import annotations

import ast
import builtins
import json
import math
import os
import shlex
import traceback
from inspect import Parameter, Signature, signature, unwrap
from itertools import islice
from math import isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from barc_sim.errors import UserError
from barc_sim.lab.handout import FILES, files_in
from barc_sim.lab.user_code.folder import (
    BUDGET,
    NOT_WRITTEN,
    AbsentModuleError,
    Budget,
    Command,
    Folder,
    OutOfTime,
    describe_error,
    guarded,
    number,
    raised_at,
    short_repr,
)
from barc_sim.lab.user_code.source import (
    ChosenGains,
    Source,
    UserCodeError,
    find_gains,
    gain_names,
    ros_of_program,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence
    from types import ModuleType

    from typing_extensions import Self

    from barc_sim.lab.user_code.relay_program import RelayProgram

    Relay = Callable[..., Sequence[float]]  #: of linear_x, angular_z and dt=; motor and servo

_T = TypeVar('_T')

_FLOAT = {float}
#: The start of the names of the user's files, as attachments of a bag.
_ATTACHED = 'student/'
_GAINS = 3  # of a PID
#: [s] Time budget to load a file: it might import SciPy.
_LOADING = 20.0


class Called(NamedTuple):
    """A function, class or method of a user's that barc_sim calls."""

    part: str  #: its file, see `FILES`
    takes: str | None  #: the names of its arguments; None: any
    numbers: int = 0  #: that it returns; 0: any object
    returns: str = 'an object'  #: the same in words
    method: str = ''  #: of a class: what is called of its objects
    timed: bool = False  #: it may require the time step as one more argument, of any name


_ERRORS = 'two finite numbers, [e_y, e_psi]'
#: What is called of a user's files.
_CALLED = {
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
    'command': Called('identify', 't', 1, 'a finite number, the acceleration [m/s²]'),
    'estimate': Called(
        'identify',
        't v a',
        6,
        'six finite numbers: drag, friction and delay, each with its interval',
    ),
}
#: What a part is loaded for: the first of these that its file defines.
_MAIN = {
    'model': ['bikeFE'],
    'controller': ['PID'],
    'relay': ['Relay', 'relay'],
    'lane': ['Lane'],
    'identify': ['command'],
    'policy': ['policy'],
}


class UserFunction:
    """A user's function, method or class, called with the arguments and options that it takes.

    What fails, takes too long or returns something else than expected is a UserCodeError: one
    sentence with the file, the line and the values.
    """

    def __init__(self, folder: Folder, function: Any, called: Called) -> None:  # noqa: ANN401 (a user's)
        """Check that `function` takes the arguments of `called`."""
        self.folder, self.function, self.called = folder, function, called
        self._call = Budget(folder.budget).call if folder.budget else _call
        found = self._signature()
        #: The names of its arguments.
        self.parameters = [*found.parameters]
        kinds = [each.kind for each in found.parameters.values()]
        self._takes_all = Parameter.VAR_KEYWORD in kinds
        self._positions = {name: position for position, name in enumerate(self.parameters)}
        self._dt = 'dt'  # its name of the time step
        takes = self.parameters if called.takes is None else called.takes.split()
        if not _binds(found, len(takes)):
            further = self.parameters[len(takes) :] if called.timed else ()
            steps = [name for name in further if _binds(found, len(takes), **{name: 0.0})]
            if not steps:
                raise UserCodeError(
                    f'{self.place()}: {self._name()} takes ({", ".join(self.parameters)}); '
                    f'expected ({", ".join(takes)})'
                )
            self._dt = steps[0]

    def __call__(self, *args: Any, **options: Any) -> Any:  # noqa: ANN401 (a user's)
        """Return what the function returns: a float, a list of floats, or an object."""
        if self._dt != 'dt':
            options[self._dt] = options.pop('dt')
        if not self._takes_all:
            positions, first = self._positions, len(args)
            options = {n: v for n, v in options.items() if positions.get(n, -1) >= first}
        try:
            result = self._call(self.function, *args, **options)
        except (Exception, SystemExit, OutOfTime) as error:
            raise self._raised(error, args, options) from error
        numbers = self.called.numbers
        if not numbers or _is_plain(result, numbers):
            return result
        found = self.attempt(_converted, result, numbers)
        if found is None:
            hint = ': is its return missing?' if result is None else ''
            raise UserCodeError(
                f'{self.place()}: {self._call_text(args, options)} returned '
                f'{short_repr(result)}; expected {self.called.returns}{hint}'
            )
        return found

    def attempt(self, function: Callable[..., _T], /, *args: object) -> _T | None:
        """Return what `function` returns of a user's values; None where it fails or takes too long.

        What a user's value does when it is inspected is the user's code, too.
        """
        found: _T | None = guarded(self._call, function, *args, default=None)
        return found

    def place(self) -> str:
        """Return the file and line that define the function, or the method that makes a class."""
        made: Any = vars(self.function).get('__init__') if isinstance(self.function, type) else None
        code = guarded(
            lambda: getattr(unwrap(made or self.function), '__code__', None), default=None
        )
        found = self.folder.place(code.co_filename, code.co_firstlineno) if code else None
        return found or self.folder.path.name

    def _signature(self) -> Signature:
        try:
            return signature(self.function)
        except Exception as error:
            raise UserCodeError(
                f'{self.place()}: expected a function, got {short_repr(self.function)}'
            ) from error

    def _raised(
        self, error: BaseException, args: tuple[Any, ...], options: Mapping[str, Any]
    ) -> UserCodeError:
        place = raised_at(self.folder, error) or self.place()
        call = self._call_text(args, options)
        if isinstance(error, OutOfTime):
            return UserCodeError(
                f'{place}: {call} did not return within {self.folder.budget or error.seconds:g} s; '
                f'expected {self.called.returns}: is there an endless loop?'
            )
        if isinstance(error, AbsentModuleError):
            return UserCodeError(f'{place}: {call} uses {error}')
        # The lab's own templates have the name TODO where code is missing.
        if isinstance(error, NotImplementedError) or getattr(error, 'name', '') == 'TODO':
            return UserCodeError(f'{place}: {self._name()} {NOT_WRITTEN}')
        text = describe_error(error).replace(str(self.folder.path) + os.sep, '')
        hint = _cause(self.folder, error)
        text = f'{text}: {hint}' if hint else text
        return UserCodeError(f'{place}: {call} raised {text}; expected {self.called.returns}')

    def _call_text(self, args: tuple[Any, ...], options: Mapping[str, Any]) -> str:
        names = [name for name in self.parameters if name not in options]
        passed = {**dict(zip(names, args, strict=False)), **options}
        values = ', '.join(f'{name}={short_repr(value)}' for name, value in passed.items())
        return f'{self._name()}({values})'

    def _name(self) -> str:
        return str(guarded(getattr, self.function, '__name__', default='a function'))


def _call(function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Any:  # noqa: ANN401
    return function(*args, **kwargs)


def _binds(found: Signature, count: int, **options: float) -> bool:
    try:
        found.bind(*range(count), **options)
    except TypeError:
        return False
    return True


def _is_plain(result: Any, count: int) -> bool:  # noqa: ANN401 (a user's)
    """Return whether a result is finite floats already, which each step checks."""
    if count == 1:
        return type(result) is float and isfinite(result)
    is_floats = type(result) is list and len(result) == count and {*map(type, result)} == _FLOAT
    return is_floats and all(map(isfinite, result))


def _converted(result: Any, count: int) -> float | list[float] | None:  # noqa: ANN401 (a user's)
    """Return a number, or a list of `count` numbers, as finite floats; None for something else."""
    if count == 1:
        value = number(result)
        return value if value is not None and isfinite(value) else None
    if hasattr(result, 'ravel'):
        result = list(islice(result.ravel(), count + 1))
    if not isinstance(result, (list, tuple)) or len(result) != count:
        return None
    values = [number(value) for value in islice(result, count)]
    finite = [value for value in values if value is not None and isfinite(value)]
    return finite if len(finite) == count else None


def _cause(folder: Folder, error: BaseException) -> str:
    """Return a sentence on the name that made a call fail; empty if none is known."""
    walked = traceback.walk_tb(error.__traceback__)
    frames = [each for each in walked if each[0].f_code.co_filename in folder.trees]
    if not frames:
        return ''
    frame, line = frames[-1]
    own: dict[str, Any] = guarded(lambda: vars(frame.f_locals['self']), default={})
    if isinstance(error, NameError) and error.name in own:
        return f'did you mean self.{error.name}?'
    if "'function'" in describe_error(error):
        return 'is a call missing, as in f(0.0)?'
    if not isinstance(error, TypeError) or 'object is not callable' not in describe_error(error):
        return ''
    names = {**frame.f_globals, **frame.f_locals, **{f'self.{n}': v for n, v in own.items()}}
    called = [
        node.func
        for node in ast.walk(folder.trees[frame.f_code.co_filename])
        if isinstance(node, ast.Call) and node.lineno <= line <= (node.end_lineno or line)
    ]
    for function in sorted(called, key=lambda node: (node.end_lineno, node.end_col_offset)):
        name = ast.unparse(function)
        if not callable(value := names.get(name, len)):
            hides = hasattr(builtins, name) or hasattr(math, name)
            missing = 'is a * missing before the bracket?'
            why = f'it hides the function {name}' if hides else missing
            return f'{name} is {short_repr(value)}: {why}'
    return ''


class UserCode:
    """A user's model, controller, relay and lane, each loaded when it is first used.

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

        Parameters
        ----------
        files
            The files.
        budget
            [s] Time budget of each call; None in the process of a submission, as in `check` and
            `grade`: no thread, and the code can import no package but NumPy.
        output
            Receives the text that user code prints; without it, that goes to stdout.
        """
        # Without `..`, for the names of folders.
        self.paths = {part: Path(os.path.abspath(file)) for part, file in (files or {}).items()}  # noqa: PTH100
        self._folders = {
            path.parent: Folder(path.parent, output, budget=budget) for path in self.paths.values()
        }
        self._loaded: dict[str, Any] = {}  # by part: a UserFunction, a RelayProgram, or its error

    def load(self) -> Self:
        """Load all parts now; return this object."""
        for part in self.paths:
            self._part(part)
        return self

    #: Their `bikeFE`; it also gets `l_f`, `l_r` and `g` if it takes them.
    model = property(lambda self: self._part('model'))
    #: Their class `PID`; it also gets `output_min` and `output_max` if it takes them.
    controller = property(lambda self: self._part('controller'))
    #: Their class `Lane`; the arguments of its constructor are its gains.
    lane = property(lambda self: self._part('lane'))
    #: Their function `command` of the time.
    identify = property(lambda self: self._part('identify'))
    #: Their function `relay`, their class `Relay`, or a whole program of ROS.
    relay = property(lambda self: self._part('relay'))

    def _part(self, part: str) -> Any:  # noqa: ANN401 (see `_loaded`)
        if part in self.paths and part not in self._loaded:
            try:
                program = self._program() if part == 'relay' else None
                self._loaded[part] = program or self.function(*_MAIN[part])
            except UserError as error:
                self._loaded[part] = error
        found = self._loaded.get(part)
        if isinstance(found, UserError):
            raise found
        return found

    def _program(self) -> RelayProgram | None:
        """Return the relay, if its file is a whole program of ROS."""
        path = self.paths['relay']
        folder = self._folders[path.parent]
        ros = ros_of_program(folder.parse(path))
        if not ros:
            return None
        from barc_sim.lab.user_code.relay_program import RelayProgram  # noqa: PLC0415 (200 ms)

        if ros == 'rospy':
            folder.tolerated.append(f'{path.name}: a program of ROS 1, which runs here without it')
        return RelayProgram(folder, path, ros)

    def function(self, *names: str, again: Mapping[str, float] | None = None) -> UserFunction:
        """Return the first of these functions or classes that its file defines.

        With `again`, the file is loaded again, so that no global variable has an old value, and
        names get these numbers.
        """
        part = _CALLED[names[0]].part
        path = self.paths[part]
        folder = self._folders[path.parent]
        if again is not None:
            self._part(part)  # raises what its first loading has raised
            folder = folder.again(again)
        name, value = _defined(folder, path, names)
        called = _CALLED[name]
        if not (isinstance(value, type) if called.method else callable(value)):
            expected = 'class' if called.method else 'function'
            raise UserCodeError(
                f'{path.name}: {name} is {short_repr(value)}; expected a {expected}'
            )
        found = UserFunction(folder, value, called)
        if called.method and not callable(guarded(getattr, value, called.method, default=None)):
            arguments = ', '.join(('self', *(_CALLED[called.method].takes or '').split()))
            raise UserCodeError(
                f'{found.place()}: the class {name} has no method {called.method}({arguments})'
            )
        if called.takes is None:
            _defaults(found)
        return found

    def new(self, part: str, *args: float, fresh: bool = False, **options: float) -> UserObject:
        """Return a new object of the class of a part.

        With `fresh`, its file is loaded again, so that no global variable has an old value.
        """
        new = self.function(*_MAIN[part], again={}) if fresh else self._part(part)
        name = new.called.method
        instance = new(*args, **options)
        method = new.attempt(getattr, instance, name)
        return UserObject(instance, UserFunction(new.folder, method, _CALLED[name]))

    def new_pid(
        self, kp: float, ki: float, kd: float, *, fresh: bool = False, **limits: float
    ) -> UserObject:
        """Return a new object of their class `PID`, which can have other names for its gains."""
        parameters = self._part('controller').parameters
        # A constructor of fewer arguments takes any three.
        names = gain_names(parameters) if len(parameters) >= _GAINS else ()
        if not names or names == tuple(parameters[:_GAINS]):
            return self.new('controller', kp, ki, kd, fresh=fresh, **limits)
        gains = dict(zip(names, (kp, ki, kd), strict=True))
        return self.new('controller', fresh=fresh, **gains, **limits)

    @property
    def lane_gains(self) -> dict[str, float]:
        """The gains of their class `Lane`: the defaults of its arguments."""
        return _defaults(self._part('lane'))

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
        if 'controller' not in self._loaded or not self.controller:
            return None
        folder, path = self.controller.folder, str(self.paths['controller'])
        return find_gains(folder.trees[path], folder.sources[path].name)

    @property
    def name(self) -> str:
        """The `NAME` in `identify.py`; empty if it has none."""
        if not self.identify:
            return ''
        module = self.identify.folder.load(self.paths['identify'])
        return guarded(lambda: str(getattr(module, 'NAME', '')), default='')

    @property
    def relay_keys(self) -> str:
        """The keys that were typed for a relay that reads them itself; empty: it reads none."""
        return str(vars(self._loaded.get('relay', self)).get('layout', ''))

    @property
    def tolerated(self) -> tuple[str, ...]:
        """What was tolerated in the loaded files, a phrase each."""
        renamed = [
            f'{path.name} is taken as {FILES[part]}: did you mean that name?'
            for part, path in self.paths.items()
            if path.name != FILES.get(part, path.name) and self._source(part)
        ]
        found = [phrase for folder in self._folders.values() for phrase in folder.tolerated]
        if self.relay_keys:
            found.append(
                f'{self.paths["relay"].name} reads keys itself: {self.relay_keys} were pressed'
            )
        return tuple(renamed + found)

    @property
    def sources(self) -> list[Source]:
        """The loaded files, and those that they import from their folders."""
        return [each for folder in self._folders.values() for each in folder.sources.values()]

    def _source(self, part: str) -> Source | None:
        path = self.paths[part]
        return self._folders[path.parent].sources.get(str(path))

    @property
    def files(self) -> dict[str, str]:
        """The names of the loaded files by part: model, controller, relay."""
        return {part: source.name for part in self.paths if (source := self._source(part))}

    def describe(self) -> dict[str, str]:
        """Return the entry of a bag's metadata: files by part, and hashes."""
        hashes = {source.name: source.sha256 for source in self.sources}
        entry = {'files': self.files, 'sha256': hashes}
        return {'student_code': json.dumps(entry)} if hashes else {}

    def attachments(self) -> dict[str, bytes]:
        """Return the user's files, by their names as attachments of a bag."""
        return {_ATTACHED + source.name: source.text.encode() for source in self.sources}


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
        value = self._step.attempt(getattr, self._instance, name, nan)
        if type(value) is not float:
            value = self._step.attempt(number, value)
        return nan if value is None else value

    def set_gains(self, gains: Mapping[str, float]) -> None:
        """Change those gains that the object has as attributes."""
        for name, value in gains.items():
            if self._step.attempt(hasattr, self._instance, name):
                self._step.attempt(setattr, self._instance, name, value)

    def reset(self) -> bool:
        """Call the object's `reset`; return whether there is one."""
        reset = self._step.attempt(getattr, self._instance, 'reset')
        if reset is None:
            return False
        called = Called('controller', '', returns='it to clear the PID')
        UserFunction(self._step.folder, reset, called)()
        return True


def _defaults(new: UserFunction) -> dict[str, float]:
    """Return the arguments of a user's class with their defaults, which must be numbers."""
    given = signature(new.function).parameters
    found = {name: new.attempt(number, each.default) for name, each in given.items()}
    for name, value in found.items():
        if value is None:
            raise UserCodeError(
                f'{new.place()}: Lane takes ({", ".join(found)}), and each is a gain: expected a '
                f'number as its default, as in {name}=0.2'
            )
    return {name: value for name, value in found.items() if value is not None}


def _defined(folder: Folder, path: Path, names: Sequence[str]) -> tuple[str, Any]:
    """Return the first of `names` that the file at `path` defines, and its value."""
    module = _load(folder, path)
    for name in names:
        if hasattr(module, name):
            return name, getattr(module, name)
    raise UserCodeError(f'{path.name} defines no {" nor ".join(reversed(names))}')


def _load(folder: Folder, path: Path) -> ModuleType:
    """Return the module of a file; a UserCodeError names why it cannot be loaded."""
    loading = Budget(_LOADING) if folder.budget else None
    try:
        return loading.call(folder.load, path) if loading else folder.load(path)
    except UserError:
        raise
    except (Exception, SystemExit, OutOfTime) as error:
        fault = f'loading the file raised {describe_error(error)}'
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
        raise UserCodeError(f'{raised_at(folder, error) or path.name}: {fault}') from error


def find_files(folder: Path, parts: Collection[str] = tuple(FILES)) -> dict[str, Path]:
    """Return the files in `folder`, by part."""
    if not folder.is_dir():
        raise UserCodeError(
            f'there is no folder {str(folder)!r}: barc new {shlex.quote(str(folder))} writes one'
        )
    if found := files_in(folder, parts):
        return found
    names = ', '.join(FILES[part] for part in parts)
    raise UserCodeError(f'the folder {str(folder)!r} has no {names}: expected one at least')


def attached(found: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the user's files among the attachments of a bag, by their own names."""
    names = {name: name.removeprefix(_ATTACHED) for name in found if name.startswith(_ATTACHED)}
    return {own: found[name] for name, own in names.items()}
