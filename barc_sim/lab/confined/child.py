"""The process for a submission: it calls its functions as requests ask.

A script that `process.py` starts without site-packages and with an empty environment. Requests and
replies are lines of JSON: `{"serial": 1, "do": NAME, "arguments": […]}` gets
`{"serial": 1, "result": …}` or `{"serial": 1, "error": TEXT}`. The first reply, with the serial 0,
comes unasked: the process is confined. It has no score, no rubric and no law of the vehicle or of
control: what a submission finds or changes here can only change its own results.
"""

from __future__ import annotations

import ctypes
import json
import os
import re
import signal
import sys
from bisect import bisect_right
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_file_location
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from types import FrameType, ModuleType

    from barc_sim.lab.user_code.code import UserCode
    from barc_sim.lab.user_code.folder import Command

MAX_TEXT = 4000  #: characters of an error; what is longer is cut
NO_PIPES = 97  #: exit code of a process whose pipes have been closed
_SET_PDEATHSIG, _SET_DUMPABLE, _SET_SECCOMP, _SET_NO_NEW_PRIVS = 1, 4, 22, 38
_MODE_FILTER, _RESTRICT_SELF = 2, 446
_INSTRUCTION = 8  # bytes of a seccomp program
_MAX_RELAY = 1 << 20  # bytes of a relay's file
_MARGIN = 0.5  # [s] of processor time, for the sentence with the line that ran out of it
_MAX_VALUES = 5000  # of the names in a function


class _Installed(MetaPathFinder):
    """Finds NumPy and rosbags, and no other package installed beside them.

    A submission may import NumPy alone; rosbags makes the messages of a relay's program.
    """

    def __init__(self, folders: dict[str, str]) -> None:
        self._folders = folders

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find the package; its own path then leads to its modules."""
        del path, target
        if name not in self._folders:
            return None
        folder = self._folders[name]
        if name == 'rosbags':  # a namespace, without an __init__.py
            spec = ModuleSpec(name, None, is_package=True)
            spec.submodule_search_locations = [folder]
            return spec
        return spec_from_file_location(
            name, f'{folder}/__init__.py', submodule_search_locations=[folder]
        )


class CodeServer:
    """Calls the functions of user code by requests: those of the methods below."""

    def __init__(self, code: UserCode) -> None:
        """Call those of `code`."""
        self._code = code
        self._controllers: dict[int, Any] = {}

    def call(self, do: str, *arguments: Any) -> Any:  # noqa: ANN401 (JSON)
        """Return what the method called `do` returns."""
        return getattr(self, do)(*arguments)

    def functions(
        self,
        name: str,
        rows: Sequence[Sequence[float]],
        options: Mapping[str, float] = {},
        again: Mapping[str, float] | None = None,
    ) -> list[list[float]]:
        """Return the result of a function for each row of its arguments.

        With `again`, its file is loaded again, and its names get these numbers.
        """
        function = self._code.function(name, again=again)
        return [function(*row, **options) for row in rows]

    def new_pid(
        self, number: int, kp: float, ki: float, kd: float, limit: float, fresh: bool
    ) -> None:
        """Make the controller `number`; with `fresh`, of its file loaded again."""
        self._controllers[number] = self._code.new_pid(
            kp, ki, kd, fresh=fresh, output_min=-limit, output_max=limit
        )

    def steps(self, number: int, rows: Sequence[tuple[float, float, float]]) -> list[float]:
        """Return the outputs of a controller for one row after the other."""
        controller = self._controller(number)
        return [controller.acc_calculate(*row) for row in rows]

    def reset(self, number: int) -> bool:
        """Call the `reset` of a controller; return whether there is one."""
        return bool(self._controller(number).reset())

    def new_lane(self, number: int, ends: Sequence[float], curvatures: Sequence[float]) -> None:
        """Make the `Lane` `number`, for a track of these segments; its file is loaded again."""
        self._controllers[number] = self._code.new('lane', fresh=True), ends, curvatures

    def steer(self, number: int, rows: Sequence[tuple[float, float, float, float]]) -> list[float]:
        """Return the outputs of a `Lane` for e_y, e_psi, speed and place on the track."""
        steer, ends, curvatures = self._controller(number)

        def ahead(place: float) -> Callable[[float], float]:
            def curvature(d: float) -> float:
                return float(curvatures[bisect_right(ends, (place + d) % ends[-1]) % len(ends)])

            curvature.__qualname__ = 'curvature'  # as an error shows it
            return curvature

        return [steer(*errors, ahead(place)) for *errors, place in rows]

    def relay(
        self, twists: Sequence[Sequence[float]], duration: float, calls: Sequence[Sequence[float]]
    ) -> Sequence[Command]:
        """Return what a relay commands: for `twists` a program, in these `calls` a function."""
        return self._code.relay_commands(twists, duration, calls)

    def lines(self, do: str, *arguments: Any) -> list[tuple[str, float]]:  # noqa: ANN401 (JSON)
        """Return the lines that give numbers to names in a request, with these; last, its return.

        Names are local ones, and those of `self`.
        """
        names = {str(source.path): source.name for source in self._code.sources}
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
            self.call(do, *arguments)
        finally:
            sys.settrace(usual)
        return found

    def name(self) -> str:
        """Return the name in `identify.py`."""
        return self._code.name

    def notes(self) -> dict[str, Any]:
        """Return the chosen gains, what was tolerated, and the keys that a relay reads."""
        code = self._code
        return {'gains': code.gains, 'tolerated': code.tolerated, 'keys': code.relay_keys}

    def _controller(self, number: int) -> Any:  # noqa: ANN401 (a UserObject, or one and its track)
        if number not in self._controllers:
            from barc_sim.errors import UserError  # noqa: PLC0415 (its folder is known by now)

            raise UserError('PID: the process of this controller has ended')
        return self._controllers[number]


def _handler(seconds: float) -> Callable[..., Any]:
    """Return what answers the requests on the files of the current folder.

    Each may use so many `seconds` of processor time: then it raises OutOfTime, which names the
    line. Code that catches this, or does not return to Python, is ended by the second alarm.
    """
    from barc_sim.lab.handout import files_in  # noqa: PLC0415
    from barc_sim.lab.user_code.code import UserCode  # noqa: PLC0415
    from barc_sim.lab.user_code.folder import OutOfTime  # noqa: PLC0415

    files = files_in(Path())
    if 'relay' in files and _uses_ros(files['relay']):
        from barc_sim.lab.user_code import relay_program  # noqa: PLC0415

        relay_program.prepare()
    call = CodeServer(UserCode(files, budget=None)).call
    if not hasattr(signal, 'setitimer'):  # Windows: the grader ends the process
        return call

    def out_of_time(_: int, __: FrameType | None) -> None:
        raise OutOfTime

    def set_alarms(first: float, second: float) -> None:
        signal.setitimer(signal.ITIMER_PROF, first)
        signal.setitimer(signal.ITIMER_VIRTUAL, second)

    def limited(*arguments: Any) -> Any:  # noqa: ANN401 (JSON)
        set_alarms(seconds, seconds + _MARGIN)
        try:
            return call(*arguments)
        finally:
            set_alarms(0.0, 0.0)
            sys.settrace(None)

    OutOfTime.seconds = seconds
    signal.signal(signal.SIGPROF, out_of_time)
    return limited


def _uses_ros(relay: Path) -> bool:
    """Return whether a relay may be a program of ROS, which needs what stands in for ROS."""
    from barc_sim.cli.files import read_regular  # noqa: PLC0415

    try:
        return re.search(rb'rclpy|rospy', read_regular(relay, _MAX_RELAY)) is not None
    except (OSError, ValueError):
        return False


def _forget_packages(packages: str) -> None:
    """Make it impossible to import more of barc_sim, or of what is installed beside it."""
    sys.path.remove(packages)
    for name, module in sys.modules.items():
        if name.partition('.')[0] == 'barc_sim' and hasattr(module, '__path__'):
            module.__path__ = []
    sys.path_importer_cache.clear()


def _limit(memory: int, cpu: int, parent: int) -> None:
    """Limit memory [bytes], processor time [s] and files; end with the process `parent`."""
    import resource  # noqa: PLC0415 (not on Windows)

    _called('prctl', _SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)  # it has already ended
    _called('prctl', _SET_DUMPABLE, 0, 0, 0, 0)
    for kind, amount in (
        (resource.RLIMIT_AS, memory),
        (resource.RLIMIT_CPU, cpu),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_CORE, 0),
        (resource.RLIMIT_NOFILE, 64),
        (resource.RLIMIT_NPROC, 0),
    ):
        # A lower hard limit stays.
        hard = resource.getrlimit(kind)[1]
        lower = amount if hard == resource.RLIM_INFINITY else min(amount, hard)
        resource.setrlimit(kind, (lower, lower))


def _confine(ruleset: int, program: bytes) -> None:
    """Allow only the files of a Landlock `ruleset`, and the system calls of a seccomp `program`."""
    _called('prctl', _SET_NO_NEW_PRIVS, 1, 0, 0, 0)
    _called('syscall', _RESTRICT_SELF, ruleset, 0)
    os.close(ruleset)
    buffer = ctypes.create_string_buffer(program, len(program))
    filter_program = _FilterProgram(len(program) // _INSTRUCTION, ctypes.addressof(buffer))
    _called('prctl', _SET_SECCOMP, _MODE_FILTER, ctypes.addressof(filter_program), 0, 0)


class _FilterProgram(ctypes.Structure):
    _fields_ = (('length', ctypes.c_ushort), ('filter', ctypes.c_void_p))


def _called(function: str, number: int, *arguments: int) -> None:
    """Call a function of the C library; its integers are pointers, sizes and flags."""
    wide = [ctypes.c_ulong(value) for value in arguments]
    if getattr(ctypes.CDLL(None, use_errno=True), function)(number, *wide) < 0:
        error = ctypes.get_errno()
        raise OSError(error, f'{function} {number} failed: {os.strerror(error)}')


def _answer(handler: Callable[..., Any], serial: int, do: str, arguments: list[Any]) -> bytes:
    reply: dict[str, Any] = {'serial': serial}
    try:
        data = json.dumps(reply | {'result': handler(do, *arguments)})
    except BaseException as error:  # noqa: BLE001 (SystemExit, too: it is the submission's)
        data = json.dumps(reply | {'error': _text(error)})
    return data.encode() + b'\n'


def _text(error: BaseException) -> str:
    try:
        # The sentences of barc_sim are whole; other exceptions have their names before them.
        own = type(error).__module__.startswith('barc_sim.')
        return (str(error) if own else f'{type(error).__name__}: {error}')[:MAX_TEXT]
    except BaseException:  # noqa: BLE001 (its text is the submission's, too)
        return 'an exception that cannot be printed'


def _serve(handler: Callable[..., Any], requests: int, replies: int) -> None:
    """Answer requests until they end."""
    with open(requests, 'rb') as lines, open(replies, 'wb', buffering=0) as out:
        out.write(b'{"serial": 0, "result": null}\n')
        for line in lines:
            data = _answer(handler, **json.loads(line))
            while data:
                data = data[out.write(data) or 0 :]


def _main() -> None:
    start = json.loads(sys.argv.pop())
    sys.path.pop(0)  # the script's own folder
    # What a submission reads and prints is not what the grader reads and prints.
    requests, replies = os.dup(0), os.dup(1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    try:
        sys.path.append(start['packages'])
        sys.meta_path.insert(0, _Installed(start['installed']))
        handler = _handler(start['call'])
        _forget_packages(start['packages'])
        if sys.platform == 'linux':
            _limit(start['memory'], start['cpu'], start['parent'])
        if start['ruleset'] is not None:
            _confine(start['ruleset'], bytes.fromhex(start['program']))
    except Exception as error:  # noqa: BLE001 (the grader prints it)
        os.write(replies, json.dumps({'serial': 0, 'error': _text(error)}).encode() + b'\n')
        sys.exit(1)
    try:
        _serve(handler, requests, replies)
    except (OSError, ValueError):
        # The submission has closed the pipes, or the grader has ended.
        os._exit(NO_PIPES)


if __name__ == '__main__':
    _main()
