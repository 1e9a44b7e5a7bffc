"""Reads a user's file, and finds errors in it before it runs: each is a UserCodeError."""

from __future__ import annotations

import ast
import hashlib
import re
import warnings
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.cli.files import open_regular
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path
    from types import CodeType

_MAX_BYTES = 1_000_000
_SHOWN = 120  #: characters of a wrong line
_PRINT = re.compile(r'print\s+(?![=(])(?:>>\s*\w[\w.]*\s*,\s*)?(.*?),?$')
#: Error messages of Python 3 about Python 2 code, and what to write instead.
_PYTHON_2 = {
    'multiple exception types': 'write "except … as …:"',
    "call to 'exec'": 'write exec(…)',
    'leading zeros in decimal': 'write an octal number as 0o…',
}


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
    """Read the file at `path`; an error if it can't be read, or is no text in UTF-8."""
    try:
        with open_regular(path) as file:
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


class Compiled(NamedTuple):
    """A file ready to run, and what was tolerated in it."""

    code: CodeType
    tree: ast.Module
    tolerated: tuple[str, ...] = ()


def compiled(source: Source) -> Compiled:
    """Compile the source, which must be Python 3; a tab goes to the next multiple of 8."""
    try:
        return _compiled(source, source.text)
    except TabError:
        pass
    except SyntaxError as error:
        raise _syntax_error(source, error) from error
    try:
        expanded = _compiled(source, _with_blanks(source.text))
    except SyntaxError as error:
        raise _syntax_error(source, error) from error
    return expanded._replace(tolerated=('tabs and blanks are mixed, a tab counts as 8',))


def _compiled(source: Source, text: str) -> Compiled:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            tree = ast.parse(text.encode(), source.name)
            return Compiled(compile(tree, str(source.path), 'exec', dont_inherit=True), tree)
    except (ValueError, RecursionError, MemoryError) as error:
        raise UserCodeError(f'{source.name} is no Python 3: {error}') from error


def _with_blanks(text: str) -> str:
    """Return `text` with the tabs of each indentation expanded."""
    lines = []
    for line in text.splitlines(keepends=True):
        rest = line.lstrip(' \t')
        lines.append(line[: len(line) - len(rest)].expandtabs(8) + rest)
    return ''.join(lines)


def _syntax_error(source: Source, error: SyntaxError) -> UserCodeError:
    text = ((error.text or '').strip() or source.line(error.lineno or 0))[:_SHOWN]
    at = f'{source.name}, line {error.lineno or 1}'
    if 'print' in error.msg and (statement := _PRINT.match(text)):
        lines = [
            str(number)
            for number, line in enumerate(source.text.splitlines(), 1)
            if _PRINT.match(line.strip())
        ]
        more = f'; so in the lines {", ".join(lines)}' if len(lines) > 1 else ''
        return UserCodeError(
            f'{at}: {text}: this is the print of Python 2: write print({statement[1]}){more}'
        )
    if python_2 := next((new for old, new in _PYTHON_2.items() if old in error.msg), ''):
        return UserCodeError(f'{at}: this is Python 2: {python_2}: {text}')
    return UserCodeError(f'{at}: syntax error: {error.msg}' + (f': {text}' if text else ''))


def guarded_lines(tree: ast.Module) -> frozenset[int]:
    """Return the lines in the body of a `try`, where a failing import has a replacement."""
    return frozenset(
        line
        for node in ast.walk(tree)
        if isinstance(node, ast.Try) and node.handlers
        for part in node.body
        for line in range(part.lineno, (part.end_lineno or part.lineno) + 1)
    )
