"""Makes a fast variant of a function: small functions inlined, branches chosen beforehand.

In Python a call costs as much as the arithmetic of `pid_step` or `next_speed`. `specialised` lets
a loop call them, each law in its one place, and run without the calls.
"""

from __future__ import annotations

import ast
import inspect
from copy import deepcopy
from textwrap import dedent
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

P = ParamSpec('P')
R = TypeVar('R')


def specialised(
    function: Callable[P, R], *inlined: Callable[..., object], record: str, **constants: bool
) -> Callable[P, R]:
    """Return `function` with each `targets = f(names)` replaced by the body of `f`.

    The results are the same to the last bit.

    Parameters
    ----------
    function
        A function of a module.
    inlined
        The functions `f`: they assign to no parameter, and only their last statement returns. One
        can call another that comes after it.
    record
        A variable that `function` assigns once: its fields are read there into variables.
    constants
        Values of names: `if NAME:` is replaced by its body, or by nothing.
    """
    tree = _definition(function)
    for each in inlined:
        tree = _Inliner(_law(each)).visit(tree)
    tree = _Chooser(constants).visit(tree)
    tree = _FieldReader(record).visit(tree)
    code = compile(ast.fix_missing_locations(ast.Module([tree], [])), __file__, 'exec')
    scope: dict[str, Any] = {}
    for each in (*inlined, function):
        scope |= each.__globals__
    exec(code, scope)  # noqa: S102 (our own source)
    made: Callable[P, R] = scope[function.__name__]
    return made


def _definition(function: Callable[..., object]) -> ast.FunctionDef:
    """Return the tree of a function, without docstring, annotations and decorators."""
    tree = ast.parse(dedent(inspect.getsource(function))).body[0]
    assert isinstance(tree, ast.FunctionDef)  # noqa: S101
    tree.body = tree.body[bool(ast.get_docstring(tree)) :]
    tree.decorator_list, tree.returns = [], None
    for parameter in tree.args.args:
        parameter.annotation = None
    return tree


def _law(function: Callable[..., object]) -> ast.FunctionDef:
    """Return the tree of a function that can be copied into another.

    Raises
    ------
    TypeError
        It returns before its end, or assigns to a parameter.
    """
    tree = _definition(function)
    returns = [each for each in ast.walk(tree) if isinstance(each, ast.Return)]
    parameters = {each.arg for each in tree.args.args}
    if returns != tree.body[-1:] or returns[0].value is None or parameters & _stored(tree):
        raise TypeError(
            f'{tree.name} cannot be copied into the closed loop: let only its last line return, '
            f'and assign to none of {", ".join(sorted(parameters))}'
        )
    return tree


def _stored(tree: ast.AST) -> set[str]:
    """Return the names of the variables to which a tree assigns."""
    names = (each for each in ast.walk(tree) if isinstance(each, ast.Name))
    return {each.id for each in names if isinstance(each.ctx, ast.Store)}


class _Renamer(ast.NodeTransformer):
    def __init__(self, names: dict[str, str]) -> None:
        self._names = names

    def visit_Name(self, node: ast.Name) -> ast.Name:
        return ast.Name(self._names.get(node.id, node.id), node.ctx)


class _Inliner(ast.NodeTransformer):
    """Replaces calls of one function."""

    def __init__(self, law: ast.FunctionDef) -> None:
        self._law = law

    def visit_Assign(self, node: ast.Assign) -> ast.Assign | list[ast.stmt]:
        """Return the function's body in the place of a call of it."""
        call, law = node.value, self._law
        if not (isinstance(call, ast.Call) and ast.unparse(call.func) == law.name):
            return node
        parameters = [each.arg for each in law.args.args]
        arguments = [ast.unparse(each) for each in call.args]
        (target,) = node.targets
        *statements, last = law.body
        assert isinstance(last, ast.Return)  # noqa: S101
        assert last.value  # noqa: S101
        stored = _stored(law)
        names = {local: f'{law.name}_{local}' for local in stored}
        names |= dict(zip(parameters, arguments, strict=True))
        pairs = [(target, last.value)]
        if isinstance(target, ast.Tuple) and isinstance(last.value, ast.Tuple):
            pairs = [*zip(target.elts, last.value.elts, strict=True)]
        # A returned variable has the name of its target from the beginning, where that is free.
        names |= {
            value.id: ast.unparse(left)
            for left, value in pairs
            if isinstance(value, ast.Name)
            and value.id in stored
            and ast.unparse(left) not in arguments
        }
        rename = _Renamer(names).visit
        body: list[ast.stmt] = [rename(deepcopy(each)) for each in statements]
        for left, value in pairs:
            result = rename(deepcopy(value))
            if ast.unparse(left) != ast.unparse(result):
                body.append(ast.Assign([left], result))
        return body


class _FieldReader(ast.NodeTransformer):
    """Reads the fields of a record once, into variables, where the record is assigned."""

    def __init__(self, record: str) -> None:
        self._record = record
        self._reads: dict[str, ast.Assign] = {}

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        """Return the variable of a field of the record."""
        if ast.unparse(node.value) != self._record:
            return node
        name = f'{self._record}_{node.attr}'
        self._reads[name] = ast.Assign([ast.Name(name, ast.Store())], node)
        return ast.Name(name, node.ctx)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        """Return the function with the variables."""
        self.generic_visit(node)
        assigned = next(
            number
            for number, statement in enumerate(node.body, 1)
            if self._record in _stored(statement)
        )
        node.body[assigned:assigned] = self._reads.values()
        return node


class _Chooser(ast.NodeTransformer):
    """Replaces `if NAME:` by the branch that a constant chooses."""

    def __init__(self, constants: dict[str, bool]) -> None:
        self._constants = constants

    def visit_If(self, node: ast.If) -> ast.AST | list[ast.stmt]:
        """Return the chosen branch."""
        self.generic_visit(node)
        if isinstance(node.test, ast.Name) and node.test.id in self._constants:
            return node.body if self._constants[node.test.id] else node.orelse
        return node
