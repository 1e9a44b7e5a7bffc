"""A user's `bike_model.py`, `controller.py`, `relay.py` and `lane.py`, loaded without a build.

This module runs in the process of a submission: it imports no law of barc_sim.
"""

from __future__ import annotations

import json
import os
import shlex
from functools import cached_property
from inspect import signature
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from barc_sim.errors import UserError
from barc_sim.lab.handout import FILES, files_in
from barc_sim.lab.user_code.calls import (
    BUDGET,
    Budget,
    Command,
    OutOfTime,
    UserFunction,
    describe_error,
    guarded,
    number,
    raised_at,
    short_repr,
)
from barc_sim.lab.user_code.importing import Folder
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

    from typing_extensions import Self

    from barc_sim.lab.user_code.relay_program import RelayProgram

    Relay = Callable[..., Sequence[float]]  #: of linear_x, angular_z and dt=; motor and servo

_T = TypeVar('_T')
#: The start of the names of the user's files, as attachments of a bag.
_ATTACHED = 'student/'
#: [s] Time budget to load a file: it might import SciPy.
_LOADING = 20.0
_BIKE_FE = ('x', 'y', 'psi', 'v', 'a', 'd_f', 'a0', 'm', 'Ff', 'theta', 'ts')
_GAINS = ('kp', 'ki', 'kd')
_SPEEDS = ('speed_reference', 'speed_current')
#: The functions of `lane.py`: what they get, and what they return.
_LANE_FUNCTIONS = {
    'straight_errors': (('x', 'y', 'psi', 'x_0', 'y_0', 'psi_0'), '[e_y, e_psi]'),
    'arc_errors': (('x', 'y', 'psi', 'x_c', 'y_c', 'radius'), '[e_y, e_psi]'),
    'steady': (('curvature',), '[delta, e_psi]'),
}
_ERRORS = ('e_y', 'e_psi', 'speed', 'curvature')
_TWIST = ('linear_x', 'angular_z')
_STATE = 'four finite numbers, [x_next, y_next, psi_next, v_next]'
_ACCELERATION = 'a finite number, the acceleration [m/s²]'
_ANGLE = 'a finite number, the steering angle [rad]'
_COMMAND = 'two finite numbers, [motor, servo]'


class UserCode:
    """A user's model, controller and relay, each loaded when it is first used.

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
        parents = dict.fromkeys(path.parent for path in self.paths.values())
        self._folders = {
            parent: Folder(
                parent,
                output,
                f'{count}_{parent.name}/' if len(parents) > 1 else '',
                budget=budget,
            )
            for count, parent in enumerate(parents, 1)
        }
        self._faults: dict[str, UserError] = {}
        self.lane_gains: dict[str, float] = {}  #: of `lane.py`, which is loaded, by name

    def load(self) -> Self:
        """Load all parts now; return this object."""
        for part in self.paths:
            getattr(self, part)
        return self

    @cached_property
    def model(self) -> UserFunction | None:
        """Their `bikeFE`; it also gets `l_f`, `l_r` and `g` if it takes them."""
        return self._loaded('model', self._model)

    @cached_property
    def controller(self) -> UserFunction | None:
        """Their class `PID`; it also gets `output_min` and `output_max` if it takes them."""
        return self._loaded('controller', self._controller)

    @cached_property
    def lane(self) -> UserFunction | None:
        """Their class `Lane`; the arguments of its constructor are its gains."""
        return self._loaded('lane', self._lane)

    @cached_property
    def relay(self) -> UserFunction | RelayProgram | None:
        """Their function `relay`, their class `Relay`, or a whole program of ROS."""
        return self._loaded('relay', self._relay)

    def _loaded(self, part: str, load: Callable[[Folder, Path], _T]) -> _T | None:
        if part not in self.paths:
            return None
        if part not in self._faults:
            try:
                return load(self._folders[self.paths[part].parent], self.paths[part])
            except UserError as error:
                self._faults[part] = error
        raise self._faults[part]

    def _model(self, folder: Folder, path: Path) -> UserFunction:
        function = self._named(folder, path, 'bikeFE')
        if not callable(function):
            raise UserCodeError(
                f'{path.name}: bikeFE is {short_repr(function)}; expected a function'
            )
        return UserFunction(folder, function, _BIKE_FE, _STATE, numbers=4)

    def _controller(self, folder: Folder, path: Path) -> UserFunction:
        cls = self._named(folder, path, 'PID')
        if not isinstance(cls, type):
            raise UserCodeError(f'{path.name}: PID is {short_repr(cls)}; expected a class')
        return self._class(folder, cls, _GAINS, 'acc_calculate', _SPEEDS)

    def _lane(self, folder: Folder, path: Path) -> UserFunction:
        cls = self._named(folder, path, 'Lane')
        if not isinstance(cls, type):
            raise UserCodeError(f'{path.name}: Lane is {short_repr(cls)}; expected a class')
        found = guarded(signature, cls, default=None)
        takes = tuple(found.parameters) if found else ()
        new = self._class(folder, cls, takes, 'steer_calculate', _ERRORS)
        self.lane_gains = _defaults(new, path.name)
        return new

    def _class(
        self, folder: Folder, cls: type, takes: tuple[str, ...], method: str, of: tuple[str, ...]
    ) -> UserFunction:
        new = UserFunction(folder, cls, takes, 'an object')
        if not callable(guarded(getattr, cls, method, default=None)):
            raise UserCodeError(
                f'{new.place()}: the class {cls.__name__} has no method '
                f'{method}(self, {", ".join(of)})'
            )
        return new

    def _relay(self, folder: Folder, path: Path) -> UserFunction | RelayProgram:
        if ros := ros_of_program(folder.parse(path)):
            from barc_sim.lab.user_code.relay_program import RelayProgram  # noqa: PLC0415 (200 ms)

            if ros == 'rospy':
                folder.tolerated.append(
                    f'{path.name}: a program of ROS 1, which runs here without it'
                )
            return RelayProgram(folder, path, ros)
        relay = self._named(folder, path, 'Relay', 'relay')
        if isinstance(relay, type):
            return self._class(folder, relay, (), 'relay', _TWIST)
        if not callable(relay):
            raise UserCodeError(f'{path.name}: relay is {short_repr(relay)}; expected a function')
        return self._relay_function(folder, relay)

    def _relay_function(self, folder: Folder, function: Any) -> UserFunction:  # noqa: ANN401
        return UserFunction(folder, function, _TWIST, _COMMAND, numbers=2, timed=True)

    def _named(self, folder: Folder, path: Path, *names: str) -> Any:  # noqa: ANN401 (a user's)
        """Return the first of `names` that the file at `path` defines."""
        loading = Budget(_LOADING) if folder.budget else None
        try:
            module = loading.call(folder.load, path) if loading else folder.load(path)
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
        for name in names:
            if hasattr(module, name):
                return getattr(module, name)
        raise UserCodeError(f'{path.name} defines no {" nor ".join(reversed(names))}')

    def model_with(self, **numbers: float) -> UserFunction:
        """Return `bikeFE` of its file loaded again, in which names get these numbers."""
        assert self.model  # noqa: S101 (there is the file)
        return self._model(self.model.folder.again(numbers), self.paths['model'])

    def new_pid(
        self, kp: float, ki: float, kd: float, *, fresh: bool = False, **limits: float
    ) -> UserPid:
        """Return a new object of their class `PID`.

        With `fresh`, its file is loaded again, so that no global variable has an old value.
        """
        new = self.controller
        assert new  # noqa: S101 (there is the file)
        if fresh:
            new = self._controller(new.folder.again(), self.paths['controller'])
        # A constructor of fewer arguments takes any three.
        names = gain_names(new.parameters) if len(new.parameters) >= len(_GAINS) else ()
        if not names or names == tuple(new.parameters[:3]):
            instance = new(kp, ki, kd, **limits)
        else:
            instance = new(**dict(zip(names, (kp, ki, kd), strict=True)), **limits)
        method = new.attempt(getattr, instance, 'acc_calculate')
        step = UserFunction(new.folder, method, _SPEEDS, _ACCELERATION, numbers=1, timed=True)
        return UserPid(instance, step)

    def new_lane(self, *, fresh: bool = False, **gains: float) -> UserLaw:
        """Return a new object of their class `Lane`, with these gains; `fresh` as in `new_pid`."""
        new = self.lane
        assert new  # noqa: S101 (there is the file)
        if fresh:
            new = self._lane(new.folder.again(), self.paths['lane'])
        instance = new(**gains)
        method = new.attempt(getattr, instance, 'steer_calculate')
        return UserLaw(instance, UserFunction(new.folder, method, _ERRORS, _ANGLE, numbers=1))

    def lane_function(self, name: str) -> UserFunction:
        """Return a function of `lane.py`."""
        path = self.paths['lane']
        folder = self._folders[path.parent]
        takes, returns = _LANE_FUNCTIONS[name]
        function = self._named(folder, path, name)
        return UserFunction(folder, function, takes, f'two finite numbers, {returns}', numbers=2)

    def new_relay(self) -> Relay:
        """Return a new relay, to be called for a Twist `dt` seconds after the last call."""
        relay = self.relay
        assert relay  # noqa: S101 (there is the file)
        if not isinstance(relay, UserFunction):
            return relay.start()
        if not isinstance(relay.function, type):
            return relay
        return self._relay_function(relay.folder, relay.attempt(getattr, relay(), 'relay'))

    def relay_commands(
        self,
        twists: Sequence[Sequence[float]],
        duration: float,
        calls: Sequence[Sequence[float]],
    ) -> list[Command]:
        """Return what a relay commands: for `twists` a program, in these `calls` a function."""
        if self.relay and not isinstance(self.relay, UserFunction):
            return self.relay.commands(twists, duration)
        relay, dt = self.new_relay(), calls[1][0] - calls[0][0]
        return [Command(t, *relay(x, z, dt=dt)) for t, x, z in calls]

    @property
    def gains(self) -> ChosenGains | None:
        """The gains that `controller.py`, which is loaded, chooses."""
        if 'controller' not in self.__dict__ or not self.controller:
            return None
        folder, path = self.controller.folder, str(self.paths['controller'])
        return find_gains(folder.trees[path], folder.sources[path].name)

    @property
    def relay_keys(self) -> str:
        """The keys that were typed for a relay that reads them itself; empty: it reads none."""
        return str(vars(self.__dict__.get('relay', self)).get('layout', ''))

    @property
    def tolerated(self) -> tuple[str, ...]:
        """What was tolerated in the loaded files, a phrase each."""
        renamed = [
            f'{path.name} is taken as {FILES[part]}: did you mean that name?'
            for part, path in self.paths.items()
            if path.name != FILES[part] and self._source(part)
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


def _defaults(new: UserFunction, file: str) -> dict[str, float]:
    """Return the arguments of a user's constructor with their defaults, which must be numbers."""
    given = signature(new.function).parameters
    found = {name: new.attempt(number, each.default) for name, each in given.items()}
    for name, value in found.items():
        if value is None:
            raise UserCodeError(
                f'{file}: Lane takes ({", ".join(found)}), and each is a gain: expected a '
                f'number as its default, as in {name}=0.2'
            )
    return {name: value for name, value in found.items() if value is not None}


class UserObject:
    """An object of a user's class that is called step by step."""

    def __init__(self, instance: Any, step: UserFunction) -> None:  # noqa: ANN401 (a user's)
        """Use `step`, a method of the `instance`."""
        self.instance = instance  #: the object itself
        self._step = step

    def read(self, name: str) -> float:
        """Return the object's attribute `name`; NaN if it is not a number."""
        value = self._step.attempt(getattr, self.instance, name, nan)
        if type(value) is not float:
            value = self._step.attempt(number, value)
        return nan if value is None else value

    def set_gains(self, gains: Mapping[str, float]) -> None:
        """Change those gains that the object has as attributes."""
        for name, value in gains.items():
            if self._step.attempt(hasattr, self.instance, name):
                self._step.attempt(setattr, self.instance, name, value)

    def reset(self) -> bool:
        """Call the object's `reset`; return whether there is one."""
        reset = self._step.attempt(getattr, self.instance, 'reset')
        if reset is None:
            return False
        UserFunction(self._step.folder, reset, (), 'it to clear the PID')()
        return True


class UserPid(UserObject):
    """An object of a user's class `PID`."""

    def acc_calculate(self, speed_reference: float, speed_current: float, dt: float) -> float:
        """Return the acceleration [m/s²] for speeds in m/s, `dt` seconds after the last call."""
        found: float = self._step(speed_reference, speed_current, dt=dt)
        return found


class UserLaw(UserObject):
    """An object of a user's class `Lane`, called as its `steer_calculate`."""

    def __call__(
        self, e_y: float, e_psi: float, speed: float, curvature: Callable[[float], float]
    ) -> float:
        """Return the front angle [rad], as a `LaneController` does."""
        found: float = self._step(e_y, e_psi, speed, curvature)
        return found


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
