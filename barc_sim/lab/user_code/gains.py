"""Finds the gains that a user has chosen, in the text of `controller.py`, which is not run."""

from __future__ import annotations

import ast
import operator
import re
from math import isfinite
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

_CLASS = 'PID'
_NAMES = ('kp', 'ki', 'kd')
_TEMPLATE = (1.0, 1.0, 1.0)  #: the defaults in the lab's template, which nobody has chosen
_GREATEST = 1e12
_ARITHMETIC = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_Constants = dict[str, float]
#: Names of a gain, in lower case: kp, k_p, p, p_gain, gain_p, kpgain, proportional, …
_GAIN = re.compile(
    r'(?:k|gain|coeff)?_?([pid])(?:rop|nt|er)?(?:ortional|egral|ivative)?_?(?:gain|term|coeff)?'
)


class ChosenGains(NamedTuple):
    """Gains, and where they come from."""

    kp: float
    ki: float
    kd: float
    origin: str  #: as in 'controller.py, line 65'

    def __str__(self) -> str:
        """Return them as text."""
        return f'kp {self.kp:g}, ki {self.ki:g}, kd {self.kd:g} ({self.origin})'


def find_gains(trees: Mapping[str, ast.Module], file: str) -> ChosenGains | None:
    """Return the gains in `file`, one of the syntax trees by name; None if it has none.

    They come from the last call `PID(…)` of literal numbers, else from the last one of constants,
    else from the constructor's defaults, if these are not the template's.
    """
    place, constructor = next(
        ((name, c) for name, tree in trees.items() if (c := _constructor(tree))), (file, None)
    )
    parameters = _parameters(constructor) if constructor else {}
    calls = [*_calls(trees[file])]
    for wanted, origin in ((False, 'line'), (True, 'constants, line')):
        for call, constants in reversed(calls):
            found = _arguments(call, constants if wanted else {}, parameters)
            if found:
                return ChosenGains(*found, f'{file}, {origin} {call.lineno}')
    if constructor:
        defaults = [parameters.get(name) for name in gain_names([*parameters])]
        gains = _complete(defaults)
        if gains and gains != _TEMPLATE:
            return ChosenGains(*gains, f'{place}, defaults, line {constructor.lineno}')
    return None


def _constructor(tree: ast.Module) -> ast.FunctionDef | None:
    classes = (n for n in ast.walk(tree) if isinstance(n, ast.ClassDef) and n.name == _CLASS)
    methods = (part for each in classes for part in each.body if isinstance(part, ast.FunctionDef))
    return next((method for method in methods if method.name == '__init__'), None)


def _parameters(function: ast.FunctionDef) -> dict[str, float | None]:
    """Return the arguments after self, with their defaults."""
    arguments = function.args
    names = [argument.arg for argument in (*arguments.posonlyargs, *arguments.args)]
    found: dict[str, float | None] = dict.fromkeys(names[1:])
    for name, value in zip(reversed(names[1:]), reversed(arguments.defaults), strict=False):
        found[name] = _number(value, {})
    for argument, default in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True):
        found[argument.arg] = _number(default, {}) if default else None
    return found


def _calls(tree: ast.Module) -> Iterator[tuple[ast.Call, _Constants]]:
    """Yield the calls of the class, by line, with the constants that are known there."""
    outer = _constants(tree.body)
    found: list[tuple[ast.Call, _Constants]] = []
    scopes = [node for node in ast.walk(tree) if isinstance(node, (ast.Module, ast.FunctionDef))]
    for scope in scopes:
        constants = outer | _constants([*ast.walk(scope)]) if scope is not tree else outer
        found += [(node, constants) for node in _own_nodes(scope) if _is_call(node)]  # type: ignore[misc]
    yield from sorted(found, key=lambda item: item[0].lineno)


def _own_nodes(scope: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of a scope without those of its functions."""
    for node in ast.iter_child_nodes(scope):
        if not isinstance(node, ast.FunctionDef):
            yield node
            yield from _own_nodes(node)


def _is_call(node: ast.AST) -> bool:
    return isinstance(node, ast.Call) and (
        (isinstance(node.func, ast.Name) and node.func.id == _CLASS)
        or (isinstance(node.func, ast.Attribute) and node.func.attr == _CLASS)
    )


def _constants(nodes: Sequence[ast.AST]) -> _Constants:
    """Return the names that are assigned numbers; the last assignment counts."""
    found: _Constants = {}
    for node in nodes:
        if isinstance(node, ast.Assign):
            for target in node.targets:
                pairs = [(target, node.value)]
                if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                    pairs = [*zip(target.elts, node.value.elts, strict=False)]
                for name, value in pairs:
                    number = _number(value, found)
                    if isinstance(name, ast.Name) and number is not None:
                        found[name.id] = number
    return found


def _arguments(
    call: ast.Call, constants: _Constants, parameters: Mapping[str, float | None]
) -> tuple[float, float, float] | None:
    """Return the gains of a call, with the constructor's defaults for those it leaves out."""
    names = [*parameters] or [*_NAMES]
    if not call.args and not call.keywords:
        return None
    values = dict(parameters)
    given = dict(zip(names, call.args, strict=False))
    given |= {keyword.arg: keyword.value for keyword in call.keywords if keyword.arg}
    gains = gain_names(names)
    if not given.keys() & set(gains):
        return None
    for name in gains:
        if name in given:
            values[name] = _number(given[name], constants)
    return _complete([values.get(name) for name in gains])


def _complete(values: Sequence[float | None]) -> tuple[float, float, float] | None:
    if len(values) != len(_NAMES):
        return None
    kp, ki, kd = values
    return None if kp is None or ki is None or kd is None else (kp, ki, kd)


def _number(node: ast.AST, constants: _Constants) -> float | None:
    """Return the value of an expression of numbers and `constants`; None for another one."""
    if isinstance(node, ast.Constant):
        usable = type(node.value) in {int, float} and abs(node.value) <= _GREATEST  # type: ignore[arg-type]
        return float(node.value) if usable else None  # type: ignore[arg-type]
    if isinstance(node, ast.Name):
        return constants.get(node.id)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
        value = _number(node.operand, constants)
        return -value if value is not None and isinstance(node.op, ast.USub) else value
    if isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
        left, right = _number(node.left, constants), _number(node.right, constants)
        if left is None or right is None or (right == 0.0 and isinstance(node.op, ast.Div)):
            return None
        value = float(_ARITHMETIC[type(node.op)](left, right))
        return value if isfinite(value) else None
    return None


def gain_names(parameters: Sequence[str]) -> tuple[str, ...]:
    """Return those of `parameters` that are kp, ki and kd: by their names, else the first three."""
    found: dict[str, str] = {}
    for name in parameters:
        if match := _GAIN.fullmatch(name.lower()):
            found.setdefault(match[1], name)
    names = tuple(found[letter] for letter in 'pid' if letter in found)
    return names if len(names) == len('pid') else tuple(parameters[:3])
