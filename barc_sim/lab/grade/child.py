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
    from collections.abc import Iterator, Sequence
    from importlib.machinery import ModuleSpec
    from types import ModuleType

    from barc_sim.lab.user_code.functions import (
        ControllerFactory,
        RelayFactory,
        UserModel,
        UserPid,
    )
    from barc_sim.lab.user_code.relay_program import RelayProgram


class _Start(NamedTuple):
    """The command line, a JSON object."""

    requests: int
    replies: int
    ruleset: int | None  #: descriptor of Landlock's; None: not confined
    program: str  #: of seccomp, in hexadecimal digits
    parent: int  #: process id
    packages: str  #: the folder that contains barc_sim
    numpy: str  #: NumPy's package
    memory: int  #: [bytes]
    cpu: int  #: [s]


class _NumPy(MetaPathFinder):
    """Finds NumPy, and no other package installed beside it."""

    def __init__(self, folder: str) -> None:
        self._folder = folder

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find the package; its own path then leads to its modules."""
        del path, target
        if name != 'numpy':
            return None
        return spec_from_file_location(
            name, f'{self._folder}/__init__.py', submodule_search_locations=[self._folder]
        )


class _Code:
    """The submission's functions; each file is loaded at its first call."""

    def __init__(self) -> None:
        self._parts: dict[str, Any] = {}
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
        return [controller.acc_calculate(*row) for row in _rows(values[1:], protocol.STEP_COLUMNS)]

    def _states(self, l_f: float, l_r: float, *values: float) -> list[float]:
        model: UserModel = self._load('model')
        rows = _rows(values, protocol.MODEL_COLUMNS)
        return [value for row in rows for value in model(*row, l_f=l_f, l_r=l_r)]

    def _new_controller(
        self, kp: float, ki: float, kd: float, limit: float, fresh: float
    ) -> UserPid:
        new: ControllerFactory = self._load('controller')
        return (new.fresh() if fresh else new)(kp, ki, kd, output_min=-limit, output_max=limit)

    def _commands(self, duration: float, *values: float) -> list[float]:
        relay: RelayFactory | RelayProgram = self._load('relay')
        found = relay.commands(
            [TimedTwist(*row) for row in _rows(values, protocol.TWIST_COLUMNS)], duration
        )
        rows = [value for command in found for value in command]
        padding = protocol.COMMAND_COLUMNS * MOST_COMMANDS - len(rows)
        return [float(len(found)), *rows, *[0.0] * padding]

    def _load(self, part: str) -> Any:  # noqa: ANN401 (of the part's type)
        if part not in self._parts:
            loaded = loading.load_folder(Path(), [part], budget=None, packages=False)
            self._tolerated += loaded.tolerated
            self._parts[part] = getattr(loaded, part)
        return self._parts[part]

    def _notes(self) -> list[float]:
        """Return the chosen gains, and what was tolerated, as the code points of a JSON text."""
        tolerated = [*dict.fromkeys(self._tolerated)]
        gains = getattr(self._parts.get('controller'), 'chosen', None)
        while True:
            text = json.dumps({'gains': gains, 'tolerated': tolerated})
            if len(text) <= protocol.NOTES_COLUMNS:
                break
            tolerated.pop()
        return [*map(float, text.encode()), *[0.0] * (protocol.NOTES_COLUMNS - len(text))]


def _rows(values: Sequence[float], columns: int) -> Iterator[tuple[float, ...]]:
    return zip(*[iter(values)] * columns, strict=True)


def _reset(instance: Any) -> bool:  # noqa: ANN401 (a submission's object)
    """Call its `reset`; return whether there is one."""
    if not hasattr(instance, 'reset'):
        return False
    instance.reset()
    return True


def _serve(requests: int, replies: int) -> None:
    """Answer requests until they end."""
    code = _Code()
    while header := _read(requests, protocol.REQUEST.size):
        serial, operation, count = protocol.REQUEST.unpack(header)
        layout = doubles(count)
        values = layout.unpack(_read(requests, layout.size))
        try:
            result = code.call(operation, values)
            frame = protocol.REPLY.pack(serial, Status.DONE, len(result)) + doubles(
                len(result)
            ).pack(*result)
        except BaseException as error:  # noqa: BLE001 (SystemExit, too: it is the submission's)
            frame = _failure(serial, error)
        _write(replies, frame)


def _failure(serial: int, error: BaseException) -> bytes:
    try:
        text = str(error) if isinstance(error, UserError) else f'{type(error).__name__}: {error}'
        data = text.encode(errors='replace')[: protocol.MAX_TEXT]
    except BaseException:  # noqa: BLE001 (its text is the submission's, too)
        data = b'an exception that cannot be printed'
    return protocol.REPLY.pack(serial, Status.FAILED, len(data)) + data


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
    start = _Start(**json.loads(sys.argv.pop()))
    sys.path.append(start.packages)
    from barc_sim.errors import UserError
    from barc_sim.lab.grade import confinement, protocol
    from barc_sim.lab.grade.protocol import Operation, Status, doubles
    from barc_sim.lab.user_code import loading
    from barc_sim.lab.user_code.relay_program import MOST_COMMANDS
    from barc_sim.lab.user_code.ros_world import TimedTwist

    sys.path.remove(start.packages)
    sys.meta_path.insert(0, _NumPy(start.numpy))
    _forget_packages()
    try:
        confinement.limit_resources(start.memory, start.cpu, start.parent)
        if start.ruleset is not None:
            confinement.confine(start.ruleset, bytes.fromhex(start.program))
    except OSError as error:
        _write(start.replies, _failure(0, error))
        sys.exit(1)
    try:
        _write(start.replies, protocol.REPLY.pack(0, Status.DONE, 0))
        _serve(start.requests, start.replies)
    except OSError:
        # The submission has closed the pipes, or the grader has ended.
        os._exit(protocol.NO_PIPES)
