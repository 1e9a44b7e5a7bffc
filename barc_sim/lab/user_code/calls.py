"""Calls a user's function within a time budget, with errors that a user understands."""

from __future__ import annotations

import ast
import builtins
import ctypes
import math
import os
import threading
import time
import traceback
import weakref
from inspect import Parameter, Signature, signature, unwrap
from itertools import islice
from math import isfinite
from threading import get_ident
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, ParamSpec, TypeVar

from barc_sim.errors import without_addresses
from barc_sim.lab.user_code.importing import AbsentModuleError
from barc_sim.lab.user_code.source import UserCodeError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from barc_sim.lab.user_code.importing import Folder

    _P = ParamSpec('_P')

_T = TypeVar('_T')

#: [s] Default time budget of a call: a hundred steps of the car.
BUDGET = 2.0
#: In the error of a function that still is the template's.
NOT_WRITTEN = 'is not written yet (TODO)'
#: In the error of a relay that cannot be judged here.
BY_EYE = 'judge it by eye'
MAX_COMMANDS = 8000  #: of a relay's run; it has 20 a second
_SHOWN = 120
_FLOAT = {float}
_POLL = 0.05
_raise_in_thread = ctypes.pythonapi.PyThreadState_SetAsyncExc


class TimedTwist(NamedTuple):
    """A Twist on `cmd_vel`."""

    t: float  #: [s]
    linear_x: float
    angular_z: float


class Command(NamedTuple):
    """A command on `ecu`."""

    t: float  #: [s]
    motor: float
    servo: float


class Called(NamedTuple):
    """A function, class or method of a user's that barc_sim calls."""

    part: str  #: its file, see `FILES`
    takes: tuple[str, ...] | None  #: None: any arguments
    numbers: int = 0  #: that it returns; 0: any object
    returns: str = 'an object'  #: the same in words
    method: str = ''  #: of a class: what is called of its objects
    timed: bool = False  #: it may require the time step as one more argument, of any name


class OutOfTime(BaseException):
    """Raised in a call that has used up its budget; `except Exception` does not catch it."""

    seconds: ClassVar[float] = 0.0  #: of a call, in a process that an alarm interrupts


class Budget:
    """Ends calls that take longer than `seconds`, in whichever thread they are made.

    A thread checks twenty times a second whether the same call still runs. So a call costs a
    fraction of a microsecond, and time in which the whole process is stopped does not count. A
    call ends between two bytecodes; a call in C, such as `time.sleep`, ends when it returns. Not
    for nested calls, nor for several threads at once.
    """

    def __init__(self, seconds: float) -> None:
        """Allow `seconds` to each call."""
        self.seconds = seconds
        self._caller = 0
        self._count = self._seen = self._polls = 0
        self._busy = self._fired = False
        self._lock = threading.RLock()
        thread = threading.Thread(
            target=_watch, args=[weakref.ref(self)], name='time budget', daemon=True
        )
        thread.start()

    def call(self, function: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> _T:
        """Return what `function` returns, raise what it raises, or OutOfTime."""
        self._caller = get_ident()
        self._count += 1
        self._busy = True
        try:
            try:
                return function(*args, **kwargs)
            finally:
                self._busy = False
                if self._fired:
                    self._settle()
        except OutOfTime:
            self._busy = False
            self._settle()
            raise

    def _settle(self) -> None:
        """Cancel an exception that is sent and not yet raised."""
        with self._lock:
            try:
                # This one replaces the one that may be pending. Cancelling with NULL would leave
                # the interpreter checking for it for ever, and Python 3.11 hangs under a tracer.
                self._fire()
                while True:
                    pass
            except OutOfTime:
                self._fired = False

    def _fire(self) -> None:
        _raise_in_thread(ctypes.c_ulong(self._caller), ctypes.py_object(OutOfTime))

    def _check(self) -> None:
        if not self._busy or self._count != self._seen:
            self._seen = self._count
            self._polls = 0
            return
        self._polls += 1
        if self._polls * _POLL < self.seconds:
            return
        with self._lock:
            # Set before the second check: a call that ends in between cancels the exception.
            self._fired = True
            if self._busy and self._count == self._seen:
                self._fire()


def _watch(reference: weakref.ref[Budget]) -> None:
    while True:
        time.sleep(_POLL)
        budget = reference()
        if budget is None:
            return
        budget._check()  # noqa: SLF001
        del budget


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
        takes = self.parameters if called.takes is None else called.takes
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
        if not numbers:
            return result
        found = _plain(result, numbers)
        if found is None:
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


def _plain(result: Any, count: int) -> Any:  # noqa: ANN401 (a user's)
    """Return a result that is finite floats already, checked in each step; else None."""
    if count == 1:
        return result if type(result) is float and isfinite(result) else None
    if type(result) is list and len(result) == count and {*map(type, result)} == _FLOAT:
        return result if isfinite(sum(result)) or all(map(isfinite, result)) else None
    return None


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


def number(value: Any) -> float | None:  # noqa: ANN401 (a user's)
    """Return `value` as a float; None if it is not a number. An array of one number is one."""
    if isinstance(value, (str, bytes)):
        return None
    return guarded(lambda: float(value.item() if hasattr(value, 'item') else value), default=None)


def guarded(function: Callable[..., _T], *args: object, default: _T) -> _T:
    """Return what `function` returns of a user's value; `default` where it fails."""
    try:
        return function(*args)
    except (Exception, SystemExit, OutOfTime):  # noqa: BLE001 (a user's value can raise anything)
        return default


def short_repr(value: object) -> str:
    """Return `value` as text for a sentence, without addresses in memory."""
    if type(value) is float:  # `isinstance` would ask the value
        return f'{value:.9g}' if value % 1.0 else repr(value)
    kind = type.__getattribute__(type(value), '__name__')
    return _in_one_line(guarded(repr, value, default=f'<{kind} instance>'))


def _in_one_line(text: str) -> str:
    text = without_addresses(' '.join(text.split()))
    return text if len(text) <= _SHOWN else f'{text[:_SHOWN]}…'


def describe_error(error: BaseException) -> str:
    """Return an exception's type and message in one line."""
    text = _in_one_line(guarded(str, error, default=''))
    return f'{type(error).__name__}: {text}' if text else type(error).__name__


def raised_at(folder: Folder, error: BaseException) -> str | None:
    """Return the innermost file and line of the folder in an exception's traceback."""
    places = [
        place
        for frame, line in traceback.walk_tb(error.__traceback__)
        if (place := folder.place(frame.f_code.co_filename, line))
    ]
    return places[-1] if places else None


def _cause(folder: Folder, error: BaseException) -> str:
    """Return a sentence on the name that made a call fail; empty if none is known."""
    frames = [
        (frame, line)
        for frame, line in traceback.walk_tb(error.__traceback__)
        if frame.f_code.co_filename in folder.trees
    ]
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
        value = names.get(name, len)
        if not callable(value):
            hides = hasattr(builtins, name) or hasattr(math, name)
            missing = 'is a * missing before the bracket?'
            why = f'it hides the function {name}' if hides else missing
            return f'{name} is {short_repr(value)}: {why}'
    return ''
