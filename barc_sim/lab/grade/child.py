"""The process a submission runs in: it knows no score and no rubric, and answers calls.

A script, started by `process.py` without site-packages and with an empty environment. Whatever the
submission changes in here, all it can bring about are answers, which are judged elsewhere.
"""

from __future__ import annotations

import os
import sys
from importlib.abc import MetaPathFinder
from importlib.util import spec_from_file_location
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

# Python puts a script's folder here.
sys.path.pop(0)

if TYPE_CHECKING:
    from collections.abc import Sequence
    from importlib.machinery import ModuleSpec
    from types import ModuleType

    from barc_sim.lab.user_code.loading import ControllerFactory, UserModel, UserPid


class _Start(NamedTuple):
    """The command line: descriptors, the parent's process id, where to import from, limits."""

    requests: int
    replies: int
    ruleset: int  #: of Landlock; -1: not confined
    parent: int
    packages: Path  #: holds barc_sim
    numpy: Path  #: its package
    memory: int
    cpu: int

    @classmethod
    def parse(cls, arguments: Sequence[str]) -> _Start:
        """Return what `process.py` has put on the command line."""
        requests, replies, ruleset, parent, packages, numpy, memory, cpu = arguments
        return cls(
            requests=int(requests),
            replies=int(replies),
            ruleset=int(ruleset),
            parent=int(parent),
            packages=Path(packages),
            numpy=Path(numpy),
            memory=int(memory),
            cpu=int(cpu),
        )


class _NumPy(MetaPathFinder):
    """Finds NumPy, and nothing else of the packages installed beside it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find the package; its path then leads to its parts."""
        del path, target
        if name != 'numpy':
            return None
        return spec_from_file_location(
            name,
            self._folder / '__init__.py',
            submodule_search_locations=[str(self._folder)],
        )


class _Code:
    """The submission's functions, each file loaded when it is first asked for."""

    def __init__(self) -> None:
        self._model: UserModel | None = None
        self._new: ControllerFactory | None = None
        self._controllers: list[UserPid] = []

    def answer(self, operation: int, values: tuple[float, ...]) -> list[float]:
        """Do what a request asks for."""
        if operation == Operation.MODEL:
            return self._states(*values)
        if operation == Operation.NEW_PID:
            self._controllers.append(self._new_controller(*values))
            return [len(self._controllers) - 1.0]
        controller = self._controllers[int(values[0])]
        if operation == Operation.RESET:
            return [float(_reset(controller.instance))]
        rows = zip(*[iter(values[1:])] * STEP_COLUMNS, strict=True)
        return [controller.acc_calculate(*row) for row in rows]

    def _states(self, l_f: float, l_r: float, *values: float) -> list[float]:
        model = self._model = self._model or code.load_model(Path('bike_model.py'), budget=None)
        rows = zip(*[iter(values)] * MODEL_COLUMNS, strict=True)
        return [value for row in rows for value in model(*row, l_f=l_f, l_r=l_r)]

    def _new_controller(
        self, kp: float, ki: float, kd: float, output_min: float, output_max: float
    ) -> UserPid:
        if self._new is None:
            self._new = code.load_controller(Path('controller.py'), budget=None)
        return self._new(kp, ki, kd, output_min=output_min, output_max=output_max)


def _reset(instance: Any) -> bool:  # noqa: ANN401 (a submission's object)
    """Call its `reset`; return whether there is one."""
    if not hasattr(instance, 'reset'):
        return False
    instance.reset()
    return True


def _serve(requests: int, replies: int) -> None:
    """Answer until the requests end."""
    answer = _Code().answer
    while header := _read(requests, REQUEST.size):
        serial, operation, count = REQUEST.unpack(header)
        layout = doubles(count)
        values = layout.unpack(_read(requests, layout.size))
        try:
            result = answer(operation, values)
            frame = REPLY.pack(serial, Status.DONE, len(result)) + doubles(len(result)).pack(
                *result
            )
        except BaseException as error:  # noqa: BLE001 (also SystemExit: it is the submission's)
            frame = _failure(serial, error)
        _write(replies, frame)


def _failure(serial: int, error: BaseException) -> bytes:
    try:
        text = str(error) if isinstance(error, UserError) else f'{type(error).__name__}: {error}'
        data = text.encode(errors='replace')[:MAX_TEXT]
    except BaseException:  # noqa: BLE001 (its text is the submission's code, too)
        data = b'an exception that cannot be printed'
    return REPLY.pack(serial, Status.FAILED, len(data)) + data


def _read(descriptor: int, size: int) -> bytes:
    """Read exactly `size` bytes; fewer where the requests have ended."""
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
    """Leave no way to import more of barc_sim."""
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
        MAX_TEXT,
        MODEL_COLUMNS,
        NO_PIPES,
        REPLY,
        REQUEST,
        STEP_COLUMNS,
        Operation,
        Status,
        doubles,
    )
    from barc_sim.lab.user_code import loading as code

    sys.path.remove(str(start.packages))
    sys.meta_path.insert(0, _NumPy(start.numpy))
    _forget_packages()
    try:
        confinement.limit_resources(start.memory, start.cpu, start.parent)
        if start.ruleset >= 0:
            confinement.close_in(start.ruleset)
    except OSError as error:
        _write(start.replies, _failure(0, error))
        sys.exit(1)
    try:
        _write(start.replies, REPLY.pack(0, Status.DONE, 0))
        _serve(start.requests, start.replies)
    except OSError:
        # Closed by the submission, or by a grader that is gone.
        os._exit(NO_PIPES)
