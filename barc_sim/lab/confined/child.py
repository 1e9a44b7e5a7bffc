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
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType


MAX_TEXT = 4000  #: characters of an error; what is longer is cut
NO_PIPES = 97  #: exit code of a process whose pipes have been closed
_SET_PDEATHSIG, _SET_DUMPABLE, _SET_SECCOMP, _SET_NO_NEW_PRIVS = 1, 4, 22, 38
_MODE_FILTER, _RESTRICT_SELF = 2, 446
_INSTRUCTION = 8  # bytes of a seccomp program


def _handler(seconds: float) -> Callable[..., Any]:
    """Return what answers the requests on the files of the current folder.

    Each may use so many `seconds` of processor time: then it raises OutOfTime, which names the
    line. Code that catches this, or does not return to Python, is ended by the grader.
    """
    from barc_sim.lab.files import files_in  # noqa: PLC0415
    from barc_sim.lab.user_code.code import UserCode  # noqa: PLC0415
    from barc_sim.lab.user_code.folder import OutOfTime  # noqa: PLC0415

    files = files_in(Path())
    if 'relay' in files:
        from barc_sim.lab.user_code import relay_program  # noqa: PLC0415

        relay_program.prepare()
    code = UserCode(files, budget=None)
    has_alarms = hasattr(signal, 'setitimer')  # not on Windows: the grader ends the process

    def set_alarm(seconds: float) -> None:
        if has_alarms:
            signal.setitimer(signal.ITIMER_PROF, seconds)

    def out_of_time(_: int, __: FrameType | None) -> None:
        raise OutOfTime

    def handle(do: str, *arguments: Any) -> Any:  # noqa: ANN401 (JSON)
        set_alarm(seconds)
        try:
            found = getattr(code, do)
            return found(*arguments) if callable(found) else found
        finally:
            set_alarm(0.0)
            sys.settrace(None)

    OutOfTime.seconds = seconds
    if has_alarms:
        signal.signal(signal.SIGPROF, out_of_time)
    return handle


def _forget_packages(path: list[str]) -> None:
    """Make it impossible to import more of barc_sim, or of what is installed beside it."""
    sys.path[:] = path
    for name, module in sys.modules.items():
        if name.partition('.')[0] == 'barc_sim' and hasattr(module, '__path__'):
            module.__path__ = []
    sys.path_importer_cache.clear()


def _limit(memory: int, parent: int) -> None:
    """Limit memory [bytes] and files; end with the process `parent`."""
    import resource  # noqa: PLC0415 (not on Windows)

    _called('prctl', _SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)  # it has already ended
    _called('prctl', _SET_DUMPABLE, 0, 0, 0, 0)
    for kind, amount in (
        (resource.RLIMIT_AS, memory),
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
        path = [*sys.path]
        sys.path += start['packages']
        import numpy  # noqa: F401, ICN001, PLC0415 (a submission may import it, and no other)

        handler = _handler(start['call'])
        _forget_packages(path)
        if sys.platform == 'linux':
            _limit(start['memory'], start['parent'])
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
