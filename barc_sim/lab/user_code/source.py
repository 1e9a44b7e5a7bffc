"""Reads a user's file, and finds errors in it before it runs."""

from __future__ import annotations

import ast
import hashlib
import warnings
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from types import CodeType

_MAX_BYTES = 1_000_000
_ROS_1 = {'rospy', 'roslib', 'barc', 'rosbag', 'rosgraph', 'dynamic_reconfigure', 'tf'}


class UserCodeError(UserError):
    """An error in user code, as one sentence: file, line, values, what was expected.

    If user code raised an exception, that is the `__cause__`.
    """


class Source(NamedTuple):
    """A user's file, as it was loaded."""

    name: str  #: in the user's folder
    path: Path
    text: str
    sha256: str  #: of the file's bytes, which are `text` in UTF-8

    def line(self, number: int) -> str:
        """Return the line `number`, counted from 1, without surrounding blanks."""
        lines = self.text.splitlines()
        return lines[number - 1].strip() if 0 < number <= len(lines) else ''


def read(path: Path, name: str) -> Source:
    """Read the file at `path`.

    Raises
    ------
    UserCodeError
        if it can't be read, or is no text in UTF-8.
    """
    try:
        with path.open('rb') as file:
            data = file.read(_MAX_BYTES + 1)
    except OSError as error:
        raise UserCodeError(f'{str(path)!r} cannot be read: {error.strerror}') from error
    if len(data) > _MAX_BYTES:
        raise UserCodeError(f'{str(path)!r} has more than {_MAX_BYTES} bytes: is it Python?')
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        line = data.count(b'\n', 0, error.start) + 1
        raise UserCodeError(
            f'{name}, line {line}: the byte 0x{data[error.start]:02x} is not UTF-8: '
            'save the file in the encoding UTF-8'
        ) from error
    return Source(name, path, text, hashlib.sha256(data).hexdigest())


def compiled(source: Source) -> CodeType:
    """Compile the source.

    Raises
    ------
    UserCodeError
        if it is not Python 3, or the lab's template for ROS 1.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            tree = ast.parse(source.text.encode(), source.name)
            code = compile(tree, str(source.path), 'exec', dont_inherit=True)
    except SyntaxError as error:
        text = (error.text or '').strip() or source.line(error.lineno or 0)
        raise UserCodeError(
            f'{source.name}, line {error.lineno or 1}: this is no Python 3: {error.msg}'
            + (f': {text}' if text else '')
        ) from error
    except (ValueError, RecursionError, MemoryError) as error:
        raise UserCodeError(f'{source.name} is no Python 3: {error}') from error
    _refuse_ros_1(source, tree)
    return code


def _refuse_ros_1(source: Source, tree: ast.Module) -> None:
    found = list(_ros_1_imports(tree))
    if not found:
        return
    names = {name for node in found for name in _bound(node)}
    lines = {node.lineno for node in found}
    lines |= {node.lineno for node in _run_at_import(tree) if names & _used(node)}
    first = source.line(found[0].lineno)
    some = len(lines) > 1
    raise UserCodeError(
        f'{source.name}, line {found[0].lineno}: {first}: ROS 1 is not installed and '
        f'not needed: delete the line{"s" if some else ""} '
        f'{", ".join(map(str, sorted(lines)))}; barc_sim provides the nodes'
    )


def _ros_1_imports(tree: ast.Module) -> Iterator[ast.Import | ast.ImportFrom]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            modules = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            modules = [node.module or '']
        else:
            continue
        # Message packages are known by their `msg` and `srv` modules.
        if any(_ROS_1 & {m.partition('.')[0]} or m.endswith(('.msg', '.srv')) for m in modules):
            yield node


def _bound(node: ast.Import | ast.ImportFrom) -> set[str]:
    return {(alias.asname or alias.name).partition('.')[0] for alias in node.names}


def _run_at_import(tree: ast.Module) -> Iterator[ast.stmt]:
    """Yield the statements that run when the module is loaded: no definitions, no `__main__`."""
    for node in tree.body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef, ast.Import, ast.ImportFrom)):
            continue
        if not (isinstance(node, ast.If) and '__name__' in _used(node.test)):
            yield node


def _used(node: ast.AST) -> set[str]:
    return {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}
