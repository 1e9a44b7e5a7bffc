"""Calls a user's function within its time budget, with errors that a user understands."""

from __future__ import annotations

import ast
import builtins
import math
import os
import re
import traceback
from inspect import signature, unwrap
from typing import TYPE_CHECKING, Any, TypeVar

from barc_sim.lab.user_code.budget import Budget, OutOfTime
from barc_sim.lab.user_code.importing import AbsentModuleError
from barc_sim.lab.user_code.source import UserCodeError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from barc_sim.lab.user_code.importing import Folder

_T = TypeVar('_T')

#: [s] Default time budget of a call: a hundred steps of the car.
BUDGET = 2.0
_LOOKING = 1.0  #: [s] to look at a user's value
#: In the error of a function that still is the template's.
NOT_WRITTEN = 'is not written yet (TODO)'
_SHOWN = 120
_ADDRESS = re.compile(r' at 0x[0-9a-fA-F]+')


class Calls:
    """Calls of one function of a user's; what fails is a UserCodeError."""

    def __init__(
        self, folder: Folder, function: Callable[..., Any], budget: float | None, expected: str
    ) -> None:
        """Prepare calls of `function`, within `budget` [s]; it must return `expected`."""
        self._folder = folder
        self.function = function  #: the user's
        self._expected = expected
        self._call = Budget(budget).call if budget else _call
        self._budget = budget

    def __call__(self, *args: Any, **kwargs: Any) -> Any:  # noqa: ANN401 (a user's)
        """Return what the function returns within its time."""
        try:
            return self._call(self.function, *args, **kwargs)
        except (Exception, SystemExit, OutOfTime) as error:
            raise self._raised(error, args, kwargs) from error

    def attempt(self, function: Callable[..., _T], /, *args: Any) -> _T | None:  # noqa: ANN401
        """Return what `function` returns of a user's values; None where it fails or takes too long.

        What a user's value does when it is looked at is the user's code, too.
        """
        try:
            found: _T = self._call(function, *args)
        except (Exception, SystemExit, OutOfTime):  # noqa: BLE001 (a user's value)
            return None
        return found

    def attribute(self, instance: object, name: str) -> Any:  # noqa: ANN401 (a user's)
        """Return a method of what the function has returned."""
        found = self.attempt(getattr, instance, name)
        if found is None:
            raise UserCodeError(
                f'{defined_at(self._folder, self.function)}: {_name(self.function)}(…) returned '
                f'{short_repr(instance)}, whose {name} cannot be read; expected a method'
            )
        return found

    def wrong(
        self, result: object, args: tuple[Any, ...], kwargs: Mapping[str, Any]
    ) -> UserCodeError:
        """Return the error for a wrong `result`."""
        hint = ': is its return missing?' if result is None else ''
        return UserCodeError(
            f'{defined_at(self._folder, self.function)}: {self._call_text(args, kwargs)} returned '
            f'{short_repr(result)}; expected {self._expected}{hint}'
        )

    def _raised(
        self, error: BaseException, args: tuple[Any, ...], kwargs: Mapping[str, Any]
    ) -> UserCodeError:
        place = raised_at(self._folder, error) or defined_at(self._folder, self.function)
        call = self._call_text(args, kwargs)
        if isinstance(error, OutOfTime):
            return UserCodeError(
                f'{place}: {call} did not return within {self._budget or error.seconds:g} s; '
                f'expected {self._expected}: is there an endless loop?'
            )
        if isinstance(error, AbsentModuleError):
            return UserCodeError(f'{place}: {call} uses {error}')
        # The lab's own templates have the name TODO where code is missing.
        if isinstance(error, NotImplementedError) or getattr(error, 'name', '') == 'TODO':
            return UserCodeError(f'{place}: {_name(self.function)} {NOT_WRITTEN}')
        return UserCodeError(
            f'{place}: {call} raised {self._described(error)}; expected {self._expected}'
        )

    def _described(self, error: BaseException) -> str:
        """Return an exception's text, with its cause where a name shows it."""
        text = describe_error(error).replace(str(self._folder.path) + os.sep, '')
        hint = cause(self._folder, error)
        return f'{text}: {hint}' if hint else text

    def _call_text(self, args: tuple[Any, ...], kwargs: Mapping[str, Any]) -> str:
        names = [name for name in signature(self.function).parameters if name not in kwargs]
        passed = {**dict(zip(names, args, strict=False)), **kwargs}
        values = ', '.join(f'{name}={short_repr(value)}' for name, value in passed.items())
        return f'{_name(self.function)}({values})'


def _call(function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Any:  # noqa: ANN401
    return function(*args, **kwargs)


def guarded(function: Callable[..., _T], *args: object, default: _T) -> _T:
    """Return what `function` returns of a user's value; `default` where it fails or is slow."""
    try:
        call = Budget(_LOOKING).call
    except RuntimeError:  # graded code has no threads, and a limit for all of it
        call = _call
    try:
        return call(function, *args)
    except (Exception, SystemExit, OutOfTime):  # noqa: BLE001 (as above)
        return default


def _name(function: object) -> str:
    return str(guarded(getattr, function, '__name__', default='a function'))


def number(value: Any) -> float | None:  # noqa: ANN401 (a user's)
    """Return `value` as a float; None if it is not a number. An array of one number is one."""
    if isinstance(value, (str, bytes)):
        return None
    try:
        return float(value.item() if hasattr(value, 'item') else value)
    except Exception:  # noqa: BLE001 (a user's value can raise anything)
        return None


def short_repr(value: object) -> str:
    """Return `value` as text for a sentence, without addresses in memory."""
    if type(value) is float:  # `isinstance` would ask the value
        return f'{value:.9g}' if value % 1.0 else repr(value)
    kind = type.__getattribute__(type(value), '__name__')
    return _in_one_line(guarded(repr, value, default=f'<{kind} instance>'))


def without_addresses(text: str) -> str:
    """Return a text without addresses in memory, which differ from run to run."""
    return _ADDRESS.sub('', text)


def _in_one_line(text: str) -> str:
    text = without_addresses(' '.join(text.split()))
    return text if len(text) <= _SHOWN else f'{text[:_SHOWN]}…'


def describe_error(error: BaseException) -> str:
    """Return an exception's type and message in one line."""
    text = _in_one_line(guarded(str, error, default=''))
    return f'{type(error).__name__}: {text}' if text else type(error).__name__


def defined_at(folder: Folder, function: Callable[..., Any]) -> str:
    """Return the file and line that define `function`."""
    code = guarded(lambda: getattr(unwrap(function), '__code__', None), default=None)
    place = _place(folder, code.co_filename, code.co_firstlineno) if code else None
    return place or f'{folder.path.name}'


def raised_at(folder: Folder, error: BaseException) -> str | None:
    """Return the innermost file and line of the folder in an exception's traceback."""
    places = [
        place
        for frame, line in traceback.walk_tb(error.__traceback__)
        if (place := _place(folder, frame.f_code.co_filename, line))
    ]
    return places[-1] if places else None


def cause(folder: Folder, error: BaseException) -> str:
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
    if not isinstance(error, TypeError) or 'object is not callable' not in describe_error(error):
        return ''
    tree = folder.trees[frame.f_code.co_filename]
    names = {**frame.f_globals, **frame.f_locals, **{f'self.{n}': v for n, v in own.items()}}
    calls = [
        node.func
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and node.lineno <= line <= (node.end_lineno or line)
    ]
    for called in sorted(calls, key=lambda node: (node.end_lineno, node.end_col_offset)):
        name = ast.unparse(called)
        value = names.get(name, len)
        if callable(value):
            continue
        if not (hasattr(builtins, name) or hasattr(math, name)):
            return f'{name} is {short_repr(value)}: is a * missing before the bracket?'
        at = _assigned_at(tree, name)
        where = f', assigned in line {at},' if at else ''
        return f'{name} is {short_repr(value)} here{where} which hides the function {name}'
    return ''


def _assigned_at(tree: ast.Module, name: str) -> int | None:
    """Return the first line that assigns to `name`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and node.id == name and isinstance(node.ctx, ast.Store):
            return node.lineno
    return None


def _place(folder: Folder, filename: str, line: int) -> str | None:
    source = folder.sources.get(filename)
    return f'{source.name}, line {line}' if source else None
