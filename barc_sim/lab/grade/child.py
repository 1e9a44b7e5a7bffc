"""The process that runs a submission: it receives calls and returns results.

A script, started by `start.py` without site-packages and with an empty environment. It has no
score and no rubric: whatever a submission changes here can only change results, which another
process judges.
"""

from __future__ import annotations

import json
import os
import sys
from importlib.abc import MetaPathFinder
from importlib.util import spec_from_file_location
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

# The script's own folder, which Python puts first.
sys.path.pop(0)

if TYPE_CHECKING:
    from collections.abc import Sequence
    from importlib.machinery import ModuleSpec
    from types import ModuleType

    from barc_sim.lab.user_code.loading import (
        ControllerFactory,
        RelayFactory,
        RelayProgram,
        UserCode,
        UserModel,
        UserPid,
    )


class _Start(NamedTuple):
    """The command line, in the order of its fields."""

    requests: int
    replies: int
    ruleset: int  #: descriptor of Landlock's; -1: not confined
    program: bytes  #: of seccomp
    parent: int  #: process id
    packages: Path  #: the folder that contains barc_sim
    numpy: Path  #: NumPy's package
    memory: int  #: [bytes]
    cpu: int  #: [s]

    @classmethod
    def parse(cls, arguments: Sequence[str]) -> _Start:
        """Return the command line that `start.py` has written."""
        requests, replies, ruleset, program, parent, packages, numpy, memory, cpu = arguments
        return cls(
            requests=int(requests),
            replies=int(replies),
            ruleset=int(ruleset),
            program=bytes.fromhex(program),
            parent=int(parent),
            packages=Path(packages),
            numpy=Path(numpy),
            memory=int(memory),
            cpu=int(cpu),
        )


class _NumPy(MetaPathFinder):
    """Finds NumPy, and no other package installed beside it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find the package; its own path then leads to its modules."""
        del path, target
        if name != 'numpy':
            return None
        return spec_from_file_location(
            name, self._folder / '__init__.py', submodule_search_locations=[str(self._folder)]
        )


class _Code:
    """The submission's functions; each file is loaded at its first call."""

    def __init__(self) -> None:
        self._model: UserModel | None = None
        self._new: ControllerFactory | None = None
        self._relay: RelayFactory | RelayProgram | None = None
        self._controllers: list[UserPid] = []
        self._tolerated: list[str] = []

    def call(self, operation: int, values: tuple[float, ...]) -> list[float]:
        """Return the result of a request."""
        if operation == Operation.MODEL:
            return self._states(*values)
        if operation == Operation.NEW_PID:
            self._controllers.append(self._new_controller(*values))
            return [len(self._controllers) - 1.0]
        if operation == Operation.NOTES:
            return self._notes()
        if operation == Operation.RELAY:
            return self._commands(*values)
        controller = self._controllers[int(values[0])]
        if operation == Operation.RESET:
            return [float(_reset(controller.instance))]
        rows = zip(*[iter(values[1:])] * STEP_COLUMNS, strict=True)
        return [controller.acc_calculate(*row) for row in rows]

    def _states(self, l_f: float, l_r: float, *values: float) -> list[float]:
        model = self._model
        if model is None:
            model = self._model = self._load('model').model
        assert model  # noqa: S101 (load_folder raises without it)
        rows = zip(*[iter(values)] * MODEL_COLUMNS, strict=True)
        return [value for row in rows for value in model(*row, l_f=l_f, l_r=l_r)]

    def _new_controller(
        self, kp: float, ki: float, kd: float, limit: float, fresh: float
    ) -> UserPid:
        if self._new is None:
            self._new = self._load('controller').controller
        assert self._new  # noqa: S101 (as above)
        new = self._new.fresh() if fresh else self._new
        return new(kp, ki, kd, output_min=-limit, output_max=limit)

    def _commands(self, duration: float, *values: float) -> list[float]:
        if self._relay is None:
            self._relay = self._load('relay').relay
        assert self._relay  # noqa: S101 (as above)
        twists = [TimedTwist(*row) for row in zip(*[iter(values)] * TWIST_COLUMNS, strict=True)]
        found = self._relay.commands(twists, duration)
        rows = [value for command in found for value in command]
        padding = COMMAND_COLUMNS * MOST_COMMANDS - len(rows)
        return [float(len(found)), *rows, *[0.0] * padding]

    def _load(self, part: str) -> UserCode:
        loaded = loading.load_folder(Path(), [part], budget=None, packages=False)
        self._tolerated += loaded.tolerated
        return loaded

    def _notes(self) -> list[float]:
        """Return the chosen gains, and what was tolerated, as the code points of a JSON text."""
        tolerated = [*dict.fromkeys(self._tolerated)]
        gains = self._new and self._new.chosen
        while True:
            text = json.dumps({'gains': gains, 'tolerated': tolerated})
            if len(text) <= NOTES_COLUMNS:
                break
            tolerated.pop()
        return [*map(float, text.encode()), *[0.0] * (NOTES_COLUMNS - len(text))]


def _reset(instance: Any) -> bool:  # noqa: ANN401 (a submission's object)
    """Call its `reset`; return whether there is one."""
    if not hasattr(instance, 'reset'):
        return False
    instance.reset()
    return True


def _serve(requests: int, replies: int) -> None:
    """Answer requests until they end."""
    code = _Code()
    while header := _read(requests, REQUEST.size):
        serial, operation, count = REQUEST.unpack(header)
        layout = doubles(count)
        values = layout.unpack(_read(requests, layout.size))
        try:
            result = code.call(operation, values)
            frame = REPLY.pack(serial, Status.DONE, len(result)) + doubles(len(result)).pack(
                *result
            )
        except BaseException as error:  # noqa: BLE001 (SystemExit, too: it is the submission's)
            frame = _failure(serial, error)
        _write(replies, frame)


def _failure(serial: int, error: BaseException) -> bytes:
    try:
        text = str(error) if isinstance(error, UserError) else f'{type(error).__name__}: {error}'
        data = text.encode(errors='replace')[:MAX_TEXT]
    except BaseException:  # noqa: BLE001 (its text is the submission's, too)
        data = b'an exception that cannot be printed'
    return REPLY.pack(serial, Status.FAILED, len(data)) + data


def _read(descriptor: int, size: int) -> bytes:
    """Read exactly `size` bytes; none if the requests have ended."""
    data = os.read(descriptor, size)
    while 0 < len(data) < size:
        more = os.read(descriptor, size - len(data))
        if not more:
            return b''
        data += more
    return data


def _write(descriptor: int, data: bytes) -> None:
    while data:
        data = data[os.write(descriptor, data) :]


def _forget_packages() -> None:
    """Make it impossible to import more of barc_sim."""
    for name, module in sys.modules.items():
        if name.partition('.')[0] == 'barc_sim' and hasattr(module, '__path__'):
            module.__path__ = []
    sys.path_importer_cache.clear()


if __name__ == '__main__':
    start = _Start.parse(sys.argv[1:])
    del sys.argv[1:]
    sys.path.append(str(start.packages))
    from barc_sim.errors import UserError
    from barc_sim.lab.grade import confinement
    from barc_sim.lab.grade.protocol import (
        COMMAND_COLUMNS,
        MAX_TEXT,
        MODEL_COLUMNS,
        NO_PIPES,
        NOTES_COLUMNS,
        REPLY,
        REQUEST,
        STEP_COLUMNS,
        TWIST_COLUMNS,
        Operation,
        Status,
        doubles,
    )
    from barc_sim.lab.user_code import loading
    from barc_sim.lab.user_code.relay_program import MOST_COMMANDS
    from barc_sim.lab.user_code.ros_world import TimedTwist

    sys.path.remove(str(start.packages))
    sys.meta_path.insert(0, _NumPy(start.numpy))
    _forget_packages()
    try:
        confinement.limit_resources(start.memory, start.cpu, start.parent)
        if start.ruleset >= 0:
            confinement.confine(start.ruleset, start.program)
    except OSError as error:
        _write(start.replies, _failure(0, error))
        sys.exit(1)
    try:
        _write(start.replies, REPLY.pack(0, Status.DONE, 0))
        _serve(start.requests, start.replies)
    except OSError:
        # The submission has closed the pipes, or the grader has ended.
        os._exit(NO_PIPES)
