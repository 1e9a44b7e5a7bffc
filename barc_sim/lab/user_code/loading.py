"""Loads a user's `bike_model.py`, `controller.py` and `relay.py` without a build."""

from __future__ import annotations

import os
import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from barc_sim.errors import UserError
from barc_sim.lab.user_code.budget import Budget, OutOfTime
from barc_sim.lab.user_code.call import BUDGET, describe_error, raised_at, short_repr
from barc_sim.lab.user_code.functions import ControllerFactory, RelayFactory, UserModel
from barc_sim.lab.user_code.gains import find_gains
from barc_sim.lab.user_code.importing import Folder
from barc_sim.lab.user_code.relay_program import (
    ROS_1,
    RelayProgram,
    TimedTwist,
    ros_of_program,
)
from barc_sim.lab.user_code.source import Source, UserCodeError

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from barc_sim.lab.user_code.functions import UserPid
    from barc_sim.lab.user_code.relay_program import Command

#: The file of each part in a user's folder.
FILES = {'model': 'bike_model.py', 'controller': 'controller.py', 'relay': 'relay.py'}
#: The script of Task 3, which is run as it is.
COMPOSE = 'compose.py'
#: [s] Time budget to load a file: it might import SciPy.
_LOADING = 20.0


@dataclass(frozen=True)
class UserCode:
    """The parts of a user's folder; None for a missing one."""

    model: UserModel | None = None
    controller: ControllerFactory | None = None
    relay: RelayFactory | RelayProgram | None = None
    #: By part, as in `FILES`, the name of its source.
    files: Mapping[str, str] = field(default_factory=dict)
    #: The files above, and those that they import from their folder.
    sources: tuple[Source, ...] = ()
    #: What was tolerated in them, a phrase each.
    tolerated: tuple[str, ...] = ()


def load_folder(
    folder: Path | str,
    parts: Collection[str] = tuple(FILES),
    *,
    budget: float | None = BUDGET,
    output: Callable[[str], object] | None = None,
    packages: bool = True,
) -> UserCode:
    """Load the files of `folder`.

    Parameters
    ----------
    folder
        A user's.
    parts
        The parts of `FILES` to load, if they exist.
    budget
        [s] Time budget of each call; None: no limit, and no thread.
    output
        Receives the text that user code prints; without it, that goes to stdout.
    packages
        Whether the code can import any installed package; else NumPy alone, as in `check` and
        `grade`.

    Raises
    ------
    UserCodeError
        if there is no such folder, nothing in it, or a file that can't be used.
    """
    files = find_files(folder, parts)
    return load_files(files, budget=budget, output=output, packages=packages)


def find_files(folder: Path | str, parts: Collection[str] = tuple(FILES)) -> dict[str, Path]:
    """Return the files in `folder`, by part.

    Raises
    ------
    UserCodeError
        if there is no such folder, or nothing in it.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise UserCodeError(
            f'there is no folder {str(folder)!r}: barc new {shlex.quote(str(folder))} writes one'
        )
    found = {part: file for part in parts if (file := find_file(folder, part))}
    if not found:
        names = ', '.join(FILES[part] for part in parts)
        raise UserCodeError(f'the folder {str(folder)!r} has no {names}: expected one at least')
    return found


def find_file(folder: Path, part: str) -> Path | None:
    """Return the file of a part in `folder`, see `find_name`."""
    name = find_name([file.name for file in folder.glob('*.py') if file.exists()], part)
    return folder / name if name else None


def find_name(names: Collection[str], part: str) -> str | None:
    """Return the name of a part's file among `names`: its own, or the only one of a similar name.

    Similar are `Bike_Model.py`, `bike_model_final(1).py` and `my_bike_model.py`.
    """
    if FILES[part] in names:
        return FILES[part]
    stem = _letters(Path(FILES[part]).stem)
    letters = {name: _letters(name[:-3]) for name in names if name.endswith('.py')}
    similar = [name for name, own in letters.items() if own.startswith(stem) or own.endswith(stem)]
    return similar[0] if len(similar) == 1 else None


def _letters(name: str) -> str:
    return ''.join(filter(str.isalpha, name.lower()))


def load_files(
    files: Mapping[str, Path],
    *,
    budget: float | None = BUDGET,
    output: Callable[[str], object] | None = None,
    packages: bool = True,
) -> UserCode:
    """Load files by part (see `FILES`), of any folders; the options are those of `load_folder`."""
    loaders: dict[str, Callable[[Folder, Path, float | None], Any]] = {
        'model': _model,
        'controller': _controller,
        'relay': _relay,
    }
    # Without `..`, for the names of folders.
    paths = {part: Path(os.path.abspath(file)) for part, file in files.items()}  # noqa: PTH100
    parents = dict.fromkeys(path.parent for path in paths.values())
    folders = {
        parent: Folder(
            parent,
            output,
            f'{number}_{parent.name}/' if len(parents) > 1 else '',
            packages=packages,
        )
        for number, parent in enumerate(parents, 1)
    }
    loaded = {
        part: loaders[part](folders[path.parent], path, budget) for part, path in paths.items()
    }
    return UserCode(
        **loaded,
        files={part: folders[path.parent].sources[str(path)].name for part, path in paths.items()},
        sources=tuple(source for folder in folders.values() for source in folder.sources.values()),
        tolerated=tuple(
            [
                f'{paths[part].name} is taken as {FILES[part]}: did you mean that name?'
                for part in paths
                if paths[part].name != FILES[part]
            ]
            + [phrase for folder in folders.values() for phrase in folder.tolerated]
        ),
    )


def _model(folder: Folder, path: Path, budget: float | None) -> UserModel:
    function = _named(folder, path, budget, ['bikeFE'])
    if not callable(function):
        raise UserCodeError(f'{path.name}: bikeFE is {short_repr(function)}; expected a function')
    return UserModel(folder, function, budget)


def _controller(folder: Folder, path: Path, budget: float | None) -> ControllerFactory:
    cls = _named(folder, path, budget, ['PID'])
    if not isinstance(cls, type):
        raise UserCodeError(f'{path.name}: PID is {short_repr(cls)}; expected a class')
    factory = ControllerFactory(folder, cls, budget)
    trees = {folder.sources[file].name: tree for file, tree in folder.trees.items()}
    factory.chosen = find_gains(trees, folder.sources[str(path.absolute())].name)
    factory.fresh = lambda: _controller(folder.again(), path, budget)
    return factory


def _relay(folder: Folder, path: Path, budget: float | None) -> RelayFactory | RelayProgram:
    if ros := ros_of_program(folder.parse(path)):
        if ros == ROS_1:
            folder.tolerated.append(f'{path.name}: a program of ROS 1, which runs here without it')
        return RelayProgram(folder, path, ros, budget)
    relay = _named(folder, path, budget, ['Relay', 'relay'])
    if not callable(relay):
        raise UserCodeError(f'{path.name}: relay is {short_repr(relay)}; expected a function')
    return RelayFactory(folder, relay, budget)


def _named(folder: Folder, path: Path, budget: float | None, names: list[str]) -> Any:  # noqa: ANN401
    """Return the first of `names` that the file at `path` defines."""
    loading = Budget(_LOADING) if budget else None
    try:
        module = loading.call(folder.load, path) if loading else folder.load(path)
    except UserCodeError:
        raise
    except (Exception, SystemExit, OutOfTime) as error:
        fault = f'loading the file raised {describe_error(error)}'
        if isinstance(error, ModuleNotFoundError):
            fault = (
                f'there is no module {error.name!r} here: install it, put it into the folder, or '
                'do without it'
            )
        elif isinstance(error, OutOfTime):
            fault = (
                f'loading the file took longer than {_LOADING if loading else error.seconds:g} s: '
                'is there an endless loop outside its functions?'
            )
        raise UserCodeError(f'{raised_at(folder, error) or path.name}: {fault}') from error
    for name in names:
        if hasattr(module, name):
            return getattr(module, name)
    raise UserCodeError(f'{path.name} defines no {" nor ".join(reversed(names))}')


class Functions:
    """The functions of a user's files, called by name; each file is loaded at its first call."""

    def __init__(self, source: UserCode | Path) -> None:
        """Call those of user code, or of the files in a folder."""
        self._parts: dict[str, Any] = {}
        self._faults: dict[str, UserError] = {}
        self._tolerated: dict[str, None] = {}
        self._controllers: dict[int, UserPid] = {}
        self._folder = Path() if isinstance(source, UserCode) else source
        if isinstance(source, UserCode):
            self._parts = {part: getattr(source, part) for part in FILES}
            self._tolerated = dict.fromkeys(source.tolerated)

    def call(self, name: str, *arguments: Any) -> Any:  # noqa: ANN401 (JSON)
        """Return what the function `name` returns, one of those below."""
        return getattr(self, name)(*arguments)

    def model(self, rows: Sequence[Sequence[float]], l_f: float, l_r: float) -> list[list[float]]:
        """Return the result of `bikeFE` for each row of its arguments."""
        model: UserModel = self._part('model')
        return [model(*row, l_f=l_f, l_r=l_r) for row in rows]

    def new_pid(
        self, number: int, kp: float, ki: float, kd: float, limit: float, fresh: bool
    ) -> None:
        """Make the controller `number`; with `fresh`, of its file loaded again."""
        new: ControllerFactory = self._part('controller')
        if fresh and hasattr(new, 'fresh'):
            new = new.fresh()
        self._controllers[number] = new(kp, ki, kd, output_min=-limit, output_max=limit)

    def steps(self, number: int, rows: Sequence[tuple[float, float, float]]) -> list[float]:
        """Return the outputs of a controller for one row after the other."""
        controller = self._controller(number)
        return [controller.acc_calculate(*row) for row in rows]

    def reset(self, number: int) -> bool:
        """Call the `reset` of a controller; return whether there is one."""
        pid = self._controller(number)
        instance = getattr(pid, 'instance', pid)
        if not hasattr(instance, 'reset'):
            return False
        try:
            instance.reset()
        except (Exception, SystemExit) as error:
            raise UserCodeError(
                f'reset() raised {describe_error(error)}; expected it to clear the PID'
            ) from error
        return True

    def relay(
        self,
        twists: Sequence[tuple[float, float, float]],
        duration: float,
        calls: Sequence[tuple[float, float, float]],
    ) -> list[Command]:
        """Return what a relay commands: for `twists` a program, in these `calls` a function."""
        relay: RelayFactory | RelayProgram = self._part('relay')
        if isinstance(relay, RelayProgram):
            return relay.commands([TimedTwist(*twist) for twist in twists], duration)
        return relay.commands([TimedTwist(*call) for call in calls])

    def notes(self) -> dict[str, Any]:
        """Return the chosen gains, and what was tolerated in the files that are loaded."""
        gains = getattr(self._parts.get('controller'), 'chosen', None)
        return {'gains': gains, 'tolerated': [*self._tolerated]}

    def _controller(self, number: int) -> UserPid:
        if number not in self._controllers:
            raise UserCodeError('PID: the process of this controller has ended')
        return self._controllers[number]

    def _part(self, part: str) -> Any:  # noqa: ANN401 (of the part's type)
        if part in self._faults:
            raise self._faults[part]
        if part not in self._parts:
            try:
                loaded = load_folder(self._folder, [part], budget=None, packages=False)
            except UserError as error:
                self._faults[part] = error
                raise
            self._tolerated |= dict.fromkeys(loaded.tolerated)
            self._parts[part] = getattr(loaded, part)
        return self._parts[part]
