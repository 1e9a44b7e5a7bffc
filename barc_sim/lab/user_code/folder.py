"""Runs the files of one folder: imports them, calls them within a time budget, names their errors.

Their modules are separate from all other modules of the process. A module that is not installed is
replaced by a stand-in, so that files that import it can still be loaded.
"""

from __future__ import annotations

import builtins
import ctypes
import io
import math
import os
import re
import sys
import threading
import time
import traceback
import weakref
from contextlib import suppress
from difflib import get_close_matches
from importlib.machinery import ModuleSpec
from importlib.util import module_from_spec
from inspect import Parameter, Signature, signature
from itertools import islice
from reprlib import Repr
from threading import get_ident
from types import ModuleType, SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, NoReturn, ParamSpec, TypeVar

from barc_sim.cli.text import one_line, without_addresses
from barc_sim.lab.files import (
    FILES,
    Called,
    ErrorKind,
    Source,
    UserCodeError,
    compiled,
    guarded_imports,
    read_source,
)
from barc_sim.lab.user_code.numpy_names import NumPy

if TYPE_CHECKING:
    import ast
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path
    from types import CodeType, FrameType

    _P = ParamSpec('_P')

_T = TypeVar('_T')

#: [s] Default time budget of a call: a hundred steps of the car.
BUDGET = 2.0
SECOND = 10**9  #: [ns]
#: The end of the sentence on a function that is still the template's.
NOT_WRITTEN = 'is not written yet (TODO)'
#: The end of the sentence on what only a person can judge.
BY_EYE = 'a person judges it'
MAX_PHRASES = 20  #: on faults that cost nothing, of those that are reported
MAX_COMMANDS = 8000  #: of a relay's run; 20 a second are usual
_SHOWN = 120
_REPR = Repr()
_REPR.maxlist = 6
_REPR.maxtuple = 6
_REPR.maxstring = _SHOWN
_REPR.maxother = _SHOWN
_FLOAT = {float}
_open = open
_POLL = 0.05
#: The import that a file lacks, by a name that it uses without one.
_IMPORTS = {
    **{name: f'from math import {name}' for name in vars(math) if not name.startswith('_')},
    'math': 'import math',
    'np': 'import numpy as np',
    'sign': 'from numpy import sign',
}
#: Hints on frequent mistakes, by a part of Python's message.
_HINTS = {
    ' for ^: ': 'a power is ** in Python',
    "'function'": 'is a call missing, as in f(0.0)?',
    "'NoneType'": 'is a value None at the first call, or is a return missing?',
    '() takes no arguments': 'is __init__ written with two underscores on each side?',
    'object is not callable': 'is a * missing before a bracket, or does a variable have the name '
    'of a function?',
}
_raise_in_thread = ctypes.pythonapi.PyThreadState_SetAsyncExc
#: Packages of ROS, and of the lab.
_ROS = {
    *('rclpy', 'rospy', 'roslib', 'barc', 'labs', 'rosbag', 'rosgraph', 'rosnode', 'rostopic'),
    *('dynamic_reconfigure', 'tf', 'tf2_ros', 'cv_bridge'),
}
#: Packages of the lab's messages, which exist in ROS 1 and in ROS 2.
_MESSAGES = re.compile(r'\w+\.(msg|srv)(\..*)?|(std|geometry|sensor|nav)_msgs(\..*)?|std_srvs')
_OPERATORS = (
    *('add', 'radd', 'sub', 'rsub', 'mul', 'rmul', 'truediv', 'rtruediv', 'pow', 'rpow', 'mod'),
    *('rmod', 'floordiv', 'rfloordiv', 'lt', 'le', 'gt', 'ge', 'neg', 'abs', 'float', 'int'),
    *('index', 'iter', 'len', 'getitem', 'setitem'),
)


class AbsentModuleError(Exception):
    """User code needs a value of a module that is not installed."""


class Absent:
    """A stand-in for a module that is not installed, and for its attributes and results.

    It can be called and has any attribute; its use as a number raises an `AbsentModuleError`.
    """

    def __init__(self, name: str, reason: str) -> None:
        """Stand in for `name`, which is missing for `reason`."""
        self._name = name
        self._reason = reason

    def __getattr__(self, name: str) -> object:
        """Return a stand-in for the attribute."""
        if name.startswith('__'):
            raise AttributeError(name)
        if name.endswith(('Exception', 'Error', 'Interrupt')):
            return type(name, (Exception,), {})
        return Absent(f'{self._name}.{name}', self._reason)

    def __call__(self, *_: object, **__: object) -> Absent:
        """Return a stand-in for the result."""
        return Absent(f'{self._name.removesuffix("()")}()', self._reason)

    def __bool__(self) -> bool:
        """Return True, so that `while not rospy.is_shutdown()` ends."""
        return True

    def __repr__(self) -> str:
        """Return the expression that it replaces."""
        return self._name

    def __mro_entries__(self, _: object) -> tuple[type, ...]:
        """Return the base class of a class derived from it."""
        return (object,)


def _refuse(self: Absent, *_: object, **__: object) -> NoReturn:
    raise AbsentModuleError(f'{self._name}, but {self._reason}')


for _operator in _OPERATORS:
    setattr(Absent, f'__{_operator}__', _refuse)


class Folder:
    """Imports modules of the folder `path`, visible only to each other.

    They are in `sys.modules` only while they are loaded, and only if no other module has their
    name, so that two folders can each have a `helpers.py`. No bytecode is written or read. A file
    never hides a module of the standard library. A module that is not installed, such as `rospy`,
    becomes an `Absent`. A file that cannot be read or compiled raises a UserCodeError.
    """

    def __init__(
        self,
        path: Path,
        output: Callable[[str], object] | None = None,
        *,
        is_judged: bool = False,
        budget: float = BUDGET,
    ) -> None:
        """Pass the modules' printed text to `output`; without it, to stdout.

        `budget` [s] is the time limit of each call. Where the code `is_judged`, the process of the
        submission has an alarm in place of it, and NumPy is the only package.
        """
        self.path = path
        self.is_judged = is_judged
        self.budget = budget
        self._output = output
        self.trees: dict[str, ast.Module] = {}  #: syntax trees of the loaded files, by path
        self.tolerated: list[str] = []  #: faults of the files that cost nothing, a phrase each
        #: Returns the module to use in place of the one with a name, or None.
        self.stand_in: Callable[[str], Any] = lambda _: None
        self.sources: dict[str, Source] = {}  #: the loaded files, by path
        self.failed: dict[Path, UserCodeError] = {}  #: the errors of files that cannot be loaded

        names = {file.stem for file in path.glob('*.py')}
        names |= {file.parent.name for file in path.glob('*/*.py')}
        self._names = names - sys.stdlib_module_names
        self._modules: dict[str, ModuleType] = {}
        #: The built-in names in all of its files.
        self.builtins = {**vars(builtins), '__import__': self._import, 'input': _no_input}
        if output:
            self.builtins['print'] = _print_to(output)

    def again(self) -> Folder:
        """Return the same folder with nothing loaded."""
        folder = Folder(self.path, self._output, is_judged=self.is_judged, budget=self.budget)
        folder.tolerated = self.tolerated
        return folder

    def time_budget(self, seconds: float) -> TimeBudget:
        """Return a time budget of `seconds`; where code is judged, one that ends no call."""
        return TimeBudget(None if self.is_judged else seconds)

    def load(self, file: Path, name: str = '') -> ModuleType:
        """Return the module of `file`, imported once, by default under its own name.

        Exceptions of the file are passed on.
        """
        name = name or (file.stem if file.stem in self._names else f'user_code_{file.stem}')
        if name in self._modules:
            return self._modules[name]

        is_package = file.name == '__init__.py'
        module = module_from_spec(ModuleSpec(name, None, is_package=is_package))
        # All of the module's functions find `import` and `print` here.
        vars(module).update(__file__=str(file), __builtins__=self.builtins)
        self._modules[name] = module

        is_new = name not in sys.modules
        if is_new:
            sys.modules[name] = module
        try:
            exec(self._compiled(file), vars(module))  # noqa: S102 (running it is the purpose)
        except BaseException:
            del self._modules[name]
            raise
        finally:
            if is_new:
                del sys.modules[name]
        return module

    def _compiled(self, file: Path) -> CodeType:
        source = read_source(file, str(file.relative_to(self.path)))
        self.sources[str(file)] = source
        result = compiled(source)
        self.trees[str(file)] = result.tree
        for phrase in result.tolerated:
            self.tolerate(f'{source.name}: {phrase}')
        return result.code

    def files_of(self, name: str) -> list[Path]:
        """Return the files of this folder's module or package `name`; empty if it has none."""
        if name not in self._names:
            return []
        package = sorted((self.path / name).rglob('*.py'))
        module = self.path / f'{name}.py'
        return [module, *package] if module.is_file() else package

    def parse(self, file: Path) -> ast.Module:
        """Return the syntax tree of `file` without running it."""
        self._compiled(file)
        return self.trees[str(file)]

    def place(self, filename: str, line: int) -> str | None:
        """Return file and line for a message; None if the file is not one of the loaded ones."""
        source = self.sources.get(filename)
        return f'{source.name}, line {line}' if source else None

    def raised_at(self, error: BaseException) -> tuple[str, FrameType] | tuple[None, None]:
        """Return the innermost file and line in an exception's traceback, and their frame."""
        innermost: tuple[str, FrameType] | tuple[None, None] = (None, None)
        for frame, line in traceback.walk_tb(error.__traceback__):
            place = self.place(frame.f_code.co_filename, line)
            if place:
                innermost = place, frame
        return innermost

    def describe(self, error: BaseException) -> str:
        """Return an exception's type and message in one line, with a hint on a known mistake."""
        text = one_line(without_addresses(guarded(str, error, default='')), _SHOWN)
        text = text.replace(str(self.path) + os.sep, '')
        hint = guarded(_hint_on, self, error, text, default='')
        return ': '.join(filter(None, (type(error).__name__, text, hint)))

    def _import(
        self,
        name: str,
        globals: dict[str, Any] | None = None,  # noqa: A002 (__import__'s own names)
        locals: dict[str, Any] | None = None,  # noqa: A002
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> ModuleType:
        importer = globals or {}
        fromlist = fromlist or ()
        if level:
            package = str(importer.get('__package__')).rsplit('.', level - 1)[0]
            name = f'{package}.{name}'.strip('.')
        top = name.partition('.')[0]

        if not level:
            stand_in: ModuleType | None = self.stand_in(name if fromlist else top)
            if stand_in:
                return stand_in
        if not name:
            # `from . import x` in a file that is loaded by itself: x is in the same folder.
            modules = {each: self._import(each, globals, locals, (each,)) for each in fromlist}
            return SimpleNamespace(**modules)  # type: ignore[return-value]
        module = self._of_folder(name) if top in self._names else None
        if not module:
            return self._import_installed(name, fromlist, importer.get('__file__', ''))
        for each in fromlist:
            if not hasattr(module, each):
                self._of_folder(f'{name}.{each}')
        return module if fromlist else self._modules[top]

    def _of_folder(self, name: str) -> ModuleType | None:
        """Return the module or package `name` of this folder; None if there is none."""
        outer, _, last = name.rpartition('.')
        package = self._of_folder(outer) if outer else None

        path = self.path.joinpath(*name.split('.'))
        if path.with_suffix('.py').is_file():
            module = self.load(path.with_suffix('.py'), name)
        elif (path / '__init__.py').is_file():
            module = self.load(path / '__init__.py', name)
        elif path.is_dir():
            module = self._modules.setdefault(name, ModuleType(name))
        else:
            return None
        if package:
            setattr(package, last, module)
        return module

    def _import_installed(self, name: str, fromlist: Sequence[str], importer: str) -> ModuleType:
        """Return a module of Python or of an installed package, or an `Absent`, to a file."""
        top = name.partition('.')[0]
        is_ros = top in _ROS or bool(_MESSAGES.fullmatch(name))
        is_of_python = top in sys.stdlib_module_names or top == 'numpy'
        if is_of_python or not (self.is_judged or is_ros):
            with suppress(ModuleNotFoundError):
                if name == 'numpy' or (top == 'numpy' and not fromlist):
                    __import__(name)
                    return self._numpy(importer)
                return __import__(name, fromlist=fromlist)

        if importer not in self.trees:  # the import comes from exec or a call of __import__
            raise ModuleNotFoundError(f'there is no module {name!r} here', name=name)
        if not is_ros and (top in guarded_imports(self.trees[importer]) or '*' in fromlist):
            raise ModuleNotFoundError(name, name=name)

        if is_ros:
            why = 'ROS is not needed'
            reason = (
                'ROS 1 is not installed and not needed: barc_sim provides the nodes, and calls PID '
                'every 0.02 s'
            )
        else:
            why = 'it is not installed here'
            reason = (
                f"there is no module {name!r} here, only NumPy and Python's own modules: install "
                'it for your own runs, put it into the folder, or do without it'
            )
        self.tolerate(f'{self.sources[importer].name} imports {name}: {why}')
        absent: Any = Absent(name if fromlist else top, reason)
        return absent  # type: ignore[no-any-return]

    def _numpy(self, importer: str) -> ModuleType:
        """Return NumPy for a file, with the names of its other versions."""
        if 'numpy' not in self._modules:
            source = self.sources.get(importer)
            file = f'{source.name}: ' if source else ''
            self._modules['numpy'] = NumPy(lambda phrase: self.tolerate(f'{file}{phrase}'))
        return self._modules['numpy']

    def open(self, file: Any, mode: str = 'r', *args: Any, **options: Any) -> Any:  # noqa: ANN401
        """Open a file for reading; text that is written to it is discarded."""
        if not isinstance(file, int) and {*mode} & {*'wax+'}:
            self.tolerate(f'{short_repr(os.path.basename(file))} is not written here')  # noqa: PTH119
            file = os.devnull
            mode = mode.replace('x', 'w')
        return _open(file, mode, *args, **options)

    def tolerate(self, phrase: str) -> None:
        """Add a phrase on a fault that costs nothing."""
        if phrase not in self.tolerated:
            self.tolerated.append(phrase)


def _print_to(output: Callable[[str], object]) -> Callable[..., None]:
    def user_print(*values: object, file: Any = None, **options: Any) -> None:  # noqa: ANN401
        text = io.StringIO()
        print(*values, file=file or text, **options)
        if not file:
            output(text.getvalue())

    return user_print


def clock(now_ns: Callable[[], int], sleep_ns: Callable[[int], object]) -> SimpleNamespace:
    """Return the module `time` with another clock."""

    def seconds() -> float:
        return now_ns() / SECOND

    def sleep(seconds: float) -> None:
        sleep_ns(round(max(float(seconds), 0.0) * SECOND))

    simulated = dict.fromkeys(('time', 'monotonic', 'perf_counter'), seconds)
    simulated |= dict.fromkeys(('time_ns', 'monotonic_ns', 'perf_counter_ns'), now_ns)
    return SimpleNamespace(**{**vars(time), **simulated, 'sleep': sleep})


def _no_input(*_: object) -> str:
    raise EOFError('input() does not work here')


class TimedTwist(NamedTuple):
    """A Twist on `cmd_vel`."""

    t: float  #: [s]
    linear_x: float
    angular_z: float


class TimedCommand(NamedTuple):
    """A command on `ecu`."""

    t: float  #: [s]
    motor: float
    servo: float


class OutOfTime(BaseException):
    """Raised in a call that has used up its time budget; `except Exception` does not catch it."""

    seconds: ClassVar[float] = 0.0  #: the budget, in a process where an alarm ends the call


class TimeBudget:
    """Ends calls that take longer than `seconds`, in any thread; None ends none.

    A thread checks twenty times a second whether the same call still runs. So a call costs a
    fraction of a microsecond, and time in which the whole process is stopped does not count. A
    call ends between two bytecodes; a call in C, such as `time.sleep`, ends when it returns. Calls
    must not be nested, and only one thread may call at a time.
    """

    def __init__(self, seconds: float | None) -> None:
        """Allow `seconds` to each call."""
        self.caller = 0  #: the thread of the latest call
        self.count = 0  #: of calls
        self.is_busy = False
        if seconds is not None:
            watched = weakref.ref(self), seconds
            threading.Thread(target=_watch, args=watched, name='time budget', daemon=True).start()

    def call(self, function: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> _T:
        """Return what `function` returns, raise what it raises, or OutOfTime."""
        self.caller = get_ident()
        self.count += 1
        self.is_busy = True
        try:
            return function(*args, **kwargs)
        finally:
            self.is_busy = False


def _watch(reference: weakref.ref[TimeBudget], seconds: float) -> None:
    last_count = 0
    polls = 0  # of the same call
    while budget := reference():
        is_same_call = budget.is_busy and budget.count == last_count
        polls = polls + 1 if is_same_call else 0
        last_count = budget.count
        if polls * _POLL >= seconds:
            polls = 0
            _raise_in_thread(ctypes.c_ulong(budget.caller), ctypes.py_object(OutOfTime))
        del budget
        time.sleep(_POLL)


def number(value: Any) -> float | None:  # noqa: ANN401 (a user's)
    """Return a number, or an array of one number, as a float; None for other values."""
    if isinstance(value, (str, bytes)):
        return None
    return guarded(lambda: float(value.item() if hasattr(value, 'item') else value), default=None)


def guarded(function: Callable[..., _T], *args: object, default: _T) -> _T:
    """Return the result of `function` for a user's value; `default` if it fails."""
    try:
        return function(*args)
    except (Exception, SystemExit, OutOfTime):  # noqa: BLE001 (a user's value can raise anything)
        return default


def short_repr(value: object) -> str:
    """Return `value` as text for a sentence, without addresses in memory."""
    if type(value) is float:  # `isinstance` could run code of the user's value
        return f'{value:.9g}' if value % 1.0 else repr(value)
    text = guarded(_REPR.repr, value, default=f'<{type(value).__name__} instance>')
    return one_line(without_addresses(text), _SHOWN)


class UserFunction:
    """A user's function, method or class, called with those options that it takes.

    A call that fails, takes too long or returns an unexpected value raises a UserCodeError: one
    sentence with the file, the line and the values.
    """

    def __init__(self, folder: Folder, function: Any, called: Called) -> None:  # noqa: ANN401 (a user's)
        """Check that `function` takes the arguments of `called`."""
        self.folder = folder
        self.function = function
        self.called = called
        self._call = folder.time_budget(folder.budget).call

        self.signature = self._signature()
        parameters = self.signature.parameters
        self.parameters = [*parameters]  #: the names of its arguments
        self._takes_all = Parameter.VAR_KEYWORD in [each.kind for each in parameters.values()]
        self._positions = {name: position for position, name in enumerate(parameters)}

        takes = self.parameters if called.takes is None else called.takes.split()
        is_timed = called.is_timed and _binds(self.signature, len(takes), dt=0.0)
        is_named = called.method and _binds(self.signature, 0, **dict.fromkeys(takes, 0.0))
        if not (is_timed or is_named or _binds(self.signature, len(takes))):
            hint = '' if self._has_self() else ': is self missing as its first argument?'
            raise UserCodeError(
                f'{self.place()}: {self._name()} takes ({", ".join(self.parameters)}); '
                f'expected ({", ".join(takes)}){hint}'
            )

    def __call__(self, *args: Any, **options: Any) -> Any:  # noqa: ANN401 (a user's)
        """Call the function; return a float, a list of floats, or an object."""
        if not self._takes_all:
            positions = self._positions
            first = len(args)
            options = {n: v for n, v in options.items() if positions.get(n, -1) >= first}
        try:
            result = self._call(self.function, *args, **options)
        except (Exception, SystemExit, OutOfTime) as error:
            raise self._error_of(error, args, options) from error

        numbers = self.called.numbers
        if not numbers or _is_plain(result, numbers):
            return result
        converted = guarded(_converted, result, numbers, default=None)
        if converted is None:
            hint = ': is its return missing?' if result is None else ''
            raise UserCodeError(
                f'{self.place()}: {self._call_text(args, options)} returned '
                f'{short_repr(result)}; expected {self.called.returns}{hint}'
            )
        return converted

    def place(self) -> str:
        """Return the file and line of the function, or of the `__init__` of a class.

        Without an `__init__` it is the file alone.
        """
        code = self._code()
        place = self.folder.place(code.co_filename, code.co_firstlineno) if code else None
        return place or FILES.get(self.called.part, self.folder.path.name)

    def _code(self) -> CodeType | None:
        function: Any = self.function
        if isinstance(function, type):
            function = vars(function).get('__init__') or function
        return getattr(function, '__code__', None)

    def _has_self(self) -> bool:
        """Return whether a method has `self` as its first argument; True for a function."""
        is_method = isinstance(self.function, type) or hasattr(self.function, '__self__')
        code = self._code() if is_method else None
        return code is None or code.co_varnames[:1] == ('self',)

    def _signature(self) -> Signature:
        try:
            return signature(self.function)
        except Exception as error:
            raise UserCodeError(
                f'{self.place()}: expected a function, got {short_repr(self.function)}'
            ) from error

    def _error_of(
        self, error: BaseException, args: tuple[Any, ...], options: Mapping[str, Any]
    ) -> UserCodeError:
        place, frame = self.folder.raised_at(error)
        place = place or self.place()
        call = self._call_text(args, options)
        if isinstance(error, OutOfTime):
            return UserCodeError(
                f'{place}: {call} did not return within {error.seconds or self.folder.budget:g} s; '
                f'expected {self.called.returns}: is there an endless loop?',
                ErrorKind.ENDLESS,
            )
        if isinstance(error, AbsentModuleError):
            return UserCodeError(f'{place}: {call} uses {error}')
        # The lab's own templates have the name TODO where code is missing.
        if isinstance(error, NotImplementedError) or getattr(error, 'name', '') == 'TODO':
            # The unwritten function can be one that this one calls, but not `<listcomp>` or so.
            name = frame.f_code.co_name if frame else '<none>'
            name = self._name() if name.startswith(('_', '<')) else name
            return UserCodeError(f'{place}: {name} {NOT_WRITTEN}', ErrorKind.NOT_WRITTEN)
        # The call can import a file that cannot be read.
        kind = error.kind if isinstance(error, UserCodeError) else ErrorKind.OTHER
        text = f'{call} raised {self.folder.describe(error)}'
        return UserCodeError(f'{place}: {text}; expected {self.called.returns}', kind)

    def _call_text(self, args: tuple[Any, ...], options: Mapping[str, Any]) -> str:
        names = [name for name in self.parameters if name not in options]
        passed = {**dict(zip(names, args, strict=False)), **options}
        values = ', '.join(f'{name}={short_repr(value)}' for name, value in passed.items())
        return f'{self._name()}({values})'

    def _name(self) -> str:
        return str(guarded(getattr, self.function, '__name__', default='a function'))


def _binds(parameters: Signature, count: int, **options: float) -> bool:
    try:
        parameters.bind(*range(count), **options)
    except TypeError:
        return False
    return True


def _is_plain(result: Any, count: int) -> bool:  # noqa: ANN401 (a user's)
    """Return whether a result needs no conversion, a fast check for each step."""
    if count == 1:
        return type(result) is float and math.isfinite(result)
    is_floats = type(result) is list and len(result) == count and {*map(type, result)} == _FLOAT
    return is_floats and all(map(math.isfinite, result))


def _converted(result: Any, count: int) -> float | list[float] | None:  # noqa: ANN401 (a user's)
    """Return a number, or a list of `count` numbers, as finite floats; None for anything else."""
    if count == 1:
        value = number(result)
        return value if value is not None and math.isfinite(value) else None
    if isinstance(result, (dict, set)):
        return None  # they have no order of results
    items = result.ravel() if hasattr(result, 'ravel') else result
    values = [number(value) for value in islice(items, count + 1)]
    finite = [value for value in values if value is not None and math.isfinite(value)]
    return finite if len(finite) == len(values) == count else None


def _hint_on(folder: Folder, error: BaseException, text: str) -> str:
    """Return a hint on an error with this text; empty if it is not a known mistake."""
    _, frame = folder.raised_at(error)
    names = frame.f_locals if frame else {}
    attributes = [*getattr(names.get('self'), '__dict__', {})]
    if isinstance(error, NameError):
        name = re.search(r"'(\w+)'", text)
        if name:
            return _hint_on_name(name[1], [*names], attributes)
    if isinstance(error, AttributeError) and 'self' in names and error.obj is names['self']:
        near = get_close_matches(error.name, attributes, 1)
        if near:
            return f'did you mean self.{near[0]}?'
        return f'is self.{error.name} set in __init__?'
    return next((hint for part, hint in _HINTS.items() if part in text), '')


def _hint_on_name(name: str, names: Sequence[str], attributes: Sequence[str]) -> str:
    """Return a hint where `name` has no value, from local names and attributes of self."""
    if name in attributes:
        return f'did you mean self.{name}?'
    if name in _IMPORTS:
        return f'is {_IMPORTS[name]} missing?'
    near = get_close_matches(name, names, 1)
    if near:
        return f'did you mean {near[0]}?'
    if 'self' in names:
        return f'set it in a line above, or keep it between calls as self.{name}'
    return ''
