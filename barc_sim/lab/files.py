"""The files of the labs: handed out, found by name in a folder, read; and the pages of reports.

How the parts are judged stands in `labs/`, and the points in `grade/rubrics/`. A user's file is
read here without running it: its errors, its gains, and whether it is a program of ROS.
"""

from __future__ import annotations

import ast
import hashlib
import os
import re
import stat
import warnings
from base64 import b64encode
from dataclasses import dataclass, field
from functools import cache, partial
from importlib import resources
from math import isfinite
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, NamedTuple

from barc_sim import __version__
from barc_sim.cli.files import open_regular, read_regular
from barc_sim.errors import UserError, escaped, one_line

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
    from types import CodeType

    from jinja2 import Environment

#: The script of Task 3 of the hills lab, which is run as it is.
COMPOSE = 'compose.py'
#: The file of a person's points and comments, beside a report.
BY_HAND = 'by_hand.yaml'
#: What is handed in beside code, and not read to grade it: plots, films, pages, bags, archives.
_EVIDENCE = (
    *('.png', '.jpg', '.jpeg', '.gif', '.svg', '.pdf', '.html', '.mp4', '.mkv', '.mov', '.webm'),
    *('.mcap', '.db3', '.bag', '.zip', '.tar.gz'),
)
MAX_FILE = 1 << 20  #: bytes
MAX_FILES = 200
MAX_TOTAL = 8 << 20  #: bytes
MAX_ARCHIVE = 256 << 20  #: bytes of a .zip
_MAX_PATH = 200  # bytes of a file's path: any file system holds it
_MAX_SOURCE = 1_000_000  #: bytes
_SHOWN = 120  #: characters of a wrong line
_INDENTATION = re.compile(r'^[ \t]+', re.MULTILINE)
_PRINT = re.compile(r'print\s+(?![=(])(?:>>\s*\w[\w.]*\s*,\s*)?(.*?),?$')
#: The defaults of PID's gains in the lab's template, which nobody has chosen.
_TEMPLATE = [1.0, 1.0, 1.0]
_MAX_GAIN = 1e12
GAINS = ('kp', 'ki', 'kd')  #: of a PID
_KEY_READERS = {
    *('curses', 'getch', 'getkey', 'keyboard', 'msvcrt', 'pygame', 'pynput', 'readchar', 'termios'),
    *('tkinter', 'Tkinter', 'tty'),
}
_INPUTS = {'sys.stdin', 'input()', 'raw_input()'}
#: What an expression of numbers and constants consists of.
_ARITHMETIC = (
    *(ast.Expression, ast.BinOp, ast.UnaryOp, ast.Constant, ast.Name, ast.Load),
    *(ast.Add, ast.Sub, ast.Mult, ast.Div, ast.USub, ast.UAdd),
)


class Handout(NamedTuple):
    """What a lab hands out, and what it wants back."""

    folder: str  #: of its templates
    files: Mapping[str, str]  #: that are loaded and judged, by part
    rubric: str  #: its name
    drive: str  #: the command that drives with a folder, less that folder
    others: tuple[str, ...] = ()  #: more files to write

    @property
    def written(self) -> str:
        """The names of the files to write."""
        return ', '.join((*self.files.values(), *self.others))

    def templates(self) -> dict[str, bytes]:
        """Return the files that a student starts with, by name."""
        folder = resources.files('barc_sim.lab') / 'templates' / self.folder
        names = ('README.md', *self.files.values(), *self.others)
        return {name: (folder / name).read_bytes() for name in names}


HILLS = Handout(
    folder='hills',
    files={'model': 'bike_model.py', 'controller': 'controller.py', 'relay': 'relay.py'},
    rubric='lab',
    drive='acc --lab',
    others=(COMPOSE,),
)
LANE = Handout(
    folder='lane',
    files={'lane': 'lane.py'},
    rubric='lane',
    drive='acc --track L --speed 6 --laps 3 --dynamics dynamic --lab',
)
RACELINE = Handout(
    folder='raceline',
    files={'raceline': 'raceline.py'},
    rubric='raceline',
    drive='acc --track L --speed-profile 3.5 2 --speed 12 --laps 3 --dynamics dynamic --lab',
)
IDENTIFY = Handout(
    folder='identify',
    files={'identify': 'identify.py'},
    rubric='identify',
    drive='acc --road flat --distance 0 --lab',
)
#: By the word of `barc new --lab`.
HANDOUTS = {'hills': HILLS, '3': LANE, '4': RACELINE, '5': IDENTIFY}
#: The file of each part of any lab.
FILES = {part: name for each in HANDOUTS.values() for part, name in each.files.items()}
#: The names of the rubrics.
RUBRICS = tuple(each.rubric for each in HANDOUTS.values())


def handout_of(parts: Collection[str]) -> Handout:
    """Return the lab of a folder with these parts: that of which the most is there."""
    return max(
        HANDOUTS.values(),
        key=lambda each: len(each.files.keys() & set(parts)) / len(each.files),
    )


def names_of(names: Collection[str], parts: Collection[str] = tuple(FILES)) -> dict[str, str]:
    """Return the names of the files of `parts` among `names`, by part, see `find_name`."""
    return {part: name for part in parts if (name := find_name(names, part))}


def files_in(folder: Path, parts: Collection[str] = tuple(FILES)) -> dict[str, Path]:
    """Return the files of `parts` in `folder`, by part, see `find_name`."""
    names = [file.name for file in folder.glob('*.py') if file.exists()]
    return {part: folder / name for part, name in names_of(names, parts).items()}


def find_name(names: Collection[str], part: str) -> str | None:
    """Return the name of a part's file among `names`: its own, or the only one of a similar name.

    Similar are `Bike_Model.py`, `bike_model_final(1).py` and `my_bike_model.py`.
    """
    if FILES[part] in names:
        return FILES[part]
    stem = _letters(Path(FILES[part]).stem)
    letters = {name: _letters(name[:-3]) for name in names if name.endswith('.py')}
    similar = [name for name, own in letters.items() if own.startswith(stem) or own.endswith(stem)]
    return similar[0] if len(similar) == 1 else None


def _letters(name: str) -> str:
    return ''.join(filter(str.isalpha, name.lower()))


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


def read(path: Path, name: str) -> Source:
    """Read the file at `path`; an error if it can't be read, or is no text in UTF-8."""
    try:
        data = read_regular(path, _MAX_SOURCE)
    except OSError as error:
        raise UserCodeError(f'{str(path)!r} cannot be read: {error.strerror}') from error
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
    tolerated: tuple[str, ...] = ()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            try:
                tree = ast.parse(source.text.encode(), source.name)
            except TabError:
                tolerated = ('tabs and blanks are mixed, a tab counts as 8',)
                text = _INDENTATION.sub(lambda match: match[0].expandtabs(8), source.text)
                tree = ast.parse(text, source.name)
            code = compile(tree, str(source.path), 'exec', dont_inherit=True)
    except SyntaxError as error:
        raise _syntax_error(source, error) from error
    except (ValueError, RecursionError, MemoryError) as error:
        raise UserCodeError(f'{source.name} is no Python 3: {error}') from error
    return Compiled(code, tree, tolerated)


def _syntax_error(source: Source, error: SyntaxError) -> UserCodeError:
    text = (error.text or '').strip()[:_SHOWN]
    at = f'{source.name}, line {error.lineno or 1}'
    if 'print' in error.msg and (statement := _PRINT.match(text)):
        return UserCodeError(
            f'{at}: {text}: this is the print of Python 2: write print({statement[1]})'
        )
    return UserCodeError(f'{at}: syntax error: {error.msg}' + (f': {text}' if text else ''))


def guarded_imports(tree: ast.Module) -> set[str]:
    """Return the modules that a file imports in a `try`, so that it can do without them."""
    return {
        name.partition('.')[0]
        for node in ast.walk(tree)
        if isinstance(node, ast.Try) and node.handlers
        for part in node.body
        for name in _imports(part)
    }


def ros_of_program(tree: ast.Module) -> str:
    """Return `rclpy` or `rospy` where a file is a program of it, and empty where it is not.

    A file that defines a function `relay` of two arguments, or a class with such a method, is
    called by the node of barc_sim, also where it imports ROS.
    """
    for node in tree.body:
        parts = node.body if isinstance(node, ast.ClassDef) and node.name == 'Relay' else [node]
        for part in parts:
            if isinstance(part, ast.FunctionDef) and part.name == 'relay':
                arguments = [each.arg for each in part.args.args if each.arg != 'self']
                if arguments[1:] or part.args.vararg:
                    return ''
    imported = {name.partition('.')[0] for node in ast.walk(tree) for name in _imports(node)}
    return next((ros for ros in ('rclpy', 'rospy') if ros in imported), '')


def key_reader(tree: ast.Module) -> str:
    """Return with what a file reads keys, such as a module; empty where it reads none."""
    nodes = [*ast.walk(tree)]
    names = [name.partition('.')[0] for node in nodes for name in _imports(node)]
    names = [name for name in names if name in _KEY_READERS]
    texts = {ast.unparse(each) for each in nodes if isinstance(each, ast.Attribute)}
    texts |= {f'{ast.unparse(each.func)}()' for each in nodes if isinstance(each, ast.Call)}
    return next(iter([*names, *sorted(texts & _INPUTS)]), '')


def _imports(node: ast.AST) -> list[str]:
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [node.module or ''] if isinstance(node, ast.ImportFrom) and not node.level else []


class ChosenGains(NamedTuple):
    """Gains, and where they come from."""

    kp: float
    ki: float
    kd: float
    origin: str  #: as in 'controller.py, line 65'

    def __str__(self) -> str:
        """Return them as text."""
        return f'kp {self.kp:g}, ki {self.ki:g}, kd {self.kd:g} ({self.origin})'


def find_gains(tree: ast.Module, file: str) -> ChosenGains | None:
    """Return the gains that a user has chosen in `file`, whose syntax tree is given.

    They are those of the last call `PID(…)` of numbers and constants, else the defaults of its
    constructor, if they are not the template's.
    """
    nodes = sorted(ast.walk(tree), key=lambda node: getattr(node, 'lineno', 0))
    constructor = next(
        (
            method
            for node in nodes
            if isinstance(node, ast.ClassDef) and node.name == 'PID'
            for method in node.body
            if isinstance(method, ast.FunctionDef) and method.name == '__init__'
        ),
        None,
    )
    parameters: dict[str, ast.expr | None] = dict.fromkeys(GAINS)
    if constructor:
        own = [argument.arg for argument in constructor.args.args][1:]
        given = zip(reversed(own), reversed(constructor.args.defaults), strict=False)
        parameters = dict.fromkeys(own) | dict(given)
    names = GAINS if {*GAINS} <= {*parameters} else [*parameters][: len(GAINS)]
    constants = _constants(nodes)
    for call in reversed(nodes):
        if not isinstance(call, ast.Call) or 'PID' not in {
            getattr(call.func, 'id', ''),
            getattr(call.func, 'attr', ''),
        }:
            continue
        passed: dict[str, ast.expr | None] = dict(zip(parameters, call.args, strict=False))
        passed |= {keyword.arg: keyword.value for keyword in call.keywords if keyword.arg}
        gains = [_number((parameters | passed).get(name), constants) for name in names]
        if passed.keys() & set(names) and (found := _chosen(gains, f'{file}, line {call.lineno}')):
            return found
    defaults = [_number(parameters[name], {}) for name in names]
    if constructor is None or defaults == _TEMPLATE:
        return None
    return _chosen(defaults, f'{file}, defaults, line {constructor.lineno}')


def _chosen(gains: Sequence[float | None], origin: str) -> ChosenGains | None:
    """Return three gains, or None where one of them is not known."""
    kp, ki, kd = gains if len(gains) == len(GAINS) else (None, None, None)
    if kp is None or ki is None or kd is None:
        return None
    return ChosenGains(kp, ki, kd, origin)


def _constants(nodes: Iterable[ast.AST]) -> dict[str, float]:
    """Return the names that are assigned numbers; the last assignment counts."""
    found: dict[str, float] = {}
    for node in nodes:
        for target in node.targets if isinstance(node, ast.Assign) else ():
            pairs = [(target, node.value)]  # type: ignore[attr-defined]
            if isinstance(target, ast.Tuple) and isinstance(pairs[0][1], ast.Tuple):
                pairs = [*zip(target.elts, pairs[0][1].elts, strict=False)]
            for name, value in pairs:
                number = _number(value, found)
                if isinstance(name, ast.Name) and number is not None:
                    found[name.id] = number
    return found


def _number(expression: ast.expr | None, constants: Mapping[str, float]) -> float | None:
    """Return the value of an expression of numbers and constants; None for another one."""
    for node in ast.walk(expression or ast.Constant(None)):
        if not isinstance(node, _ARITHMETIC) or (
            isinstance(node, ast.Constant) and type(node.value) not in {int, float}
        ):
            return None
    code = compile(ast.Expression(expression), '<gain>', 'eval')  # type: ignore[arg-type]
    try:
        value = float(eval(code, {'__builtins__': {}}, dict(constants)))  # noqa: S307 (arithmetic)
    except (ArithmeticError, NameError):
        return None
    return value if isfinite(value) and abs(value) <= _MAX_GAIN else None


@dataclass(frozen=True)
class Submission:
    """A submission's files, in memory, so that nothing else of its folder can be reached."""

    name: str  #: its folder's or archive's
    files: dict[str, bytes] = field(default_factory=dict)  #: by path in the folder
    notes: tuple[str, ...] = ()  #: on files that were left out

    def write(self, folder: Path) -> None:
        """Write the files into `folder`, which exists."""
        for name, data in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)


class Member(NamedTuple):
    """A file of a submission."""

    path: str  #: in its folder or archive, with slashes
    read: Callable[[int], bytes]  #: returns so many bytes at most
    fault: str = ''  #: why it is not read, as the rest of a sentence


def listed(folder: Path) -> Iterator[Member]:
    """Yield the files of a folder, those at its top first."""
    for directory, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not is_of_tools(name))
        links = [name for name in folders if Path(directory, name).is_symlink()]
        for name in sorted([*names, *links]):
            path = Path(directory, name)
            if not name.startswith('.'):
                fault = fault_of(path.lstat().st_mode)
                yield Member(path.relative_to(folder).as_posix(), partial(_data, path), fault)


def is_of_tools(name: str) -> bool:
    """Return whether a file or folder of this name is made by a tool, and not handed in."""
    return name.startswith(('.', '__pycache__', '__MACOSX'))


def _data(path: Path, size: int) -> bytes:
    """Return at most `size` bytes of a regular file."""
    with open_regular(path, follow=False) as file:
        return file.read(size)


def take(members: Iterable[Member], files: dict[str, bytes], notes: list[str]) -> int:
    """Add the members that a folder can hold to `files`, and notes on the others.

    Return how many there are. Plots, films and bags are left out, of any size.
    """
    seen = 0
    folders = {str(parent) for name in files for parent in PurePosixPath(name).parents}
    for seen, member in enumerate(members, 1):  # noqa: B007 (counted)
        if _is_evidence(member.path):
            continue
        if len(files) >= MAX_FILES or sum(map(len, files.values())) > MAX_TOTAL:
            notes.append(f'more than {MAX_FILES} files or {MAX_TOTAL >> 20} MiB: the rest is out')
            break
        name = one_line(member.path, _MAX_PATH)
        parents = [str(parent) for parent in PurePosixPath(member.path).parents]
        if fault := _fault(member, files, folders, parents):
            notes.append(f'{name} {fault}')
            continue
        try:
            data = member.read(MAX_FILE + 1)
        except Exception as error:  # noqa: BLE001 (a damaged file can raise any)
            notes.append(f'{name} cannot be read: {reason_of(error)}')
            continue
        if len(data) > MAX_FILE:
            notes.append(f'{name} has more than {MAX_FILE >> 20} MiB')
            continue
        files[member.path] = data
        folders.update(parents)
    return seen


def _fault(member: Member, files: dict[str, bytes], folders: set[str], parents: list[str]) -> str:
    """Return why a file cannot be taken, as the rest of a sentence; empty if it can."""
    path = PurePosixPath(member.path)
    if path.is_absolute() or '..' in path.parts:
        return 'leads out of the archive'
    if '\0' in member.path or not 0 < len(os.fsencode(path)) <= _MAX_PATH:
        return f'has a name that no file can have: at most {_MAX_PATH} bytes'
    if member.path in {*files, *folders} or any(parent in files for parent in parents):
        return 'is there twice: the first is taken'
    return member.fault


def fault_of(mode: int) -> str:
    """Return why a file of this mode is not read, as the rest of a sentence; empty if it is."""
    if stat.S_ISLNK(mode):
        return 'is a link, which is not followed'
    return '' if stat.S_ISREG(mode) else 'is no regular file'


def _is_evidence(path: str) -> bool:
    """Return whether a file is no part of the code, by its name."""
    return path.lower().endswith(_EVIDENCE) or PurePosixPath(path).name == 'metadata.yaml'


def reason_of(error: Exception) -> str:
    """Return why a file cannot be read."""
    return escaped(getattr(error, 'strerror', None) or str(error) or type(error).__name__)


def render(page: str, **values: object) -> str:
    """Return the page of that name in `pages/` as HTML without links; every value is escaped."""
    return _environment().get_template(f'{page}.html').render(version=__version__, **values)


def data_url(kind: str, data: bytes) -> str:
    """Return an image of the MIME type `kind` as a URL that contains it."""
    return f'data:{kind};base64,{b64encode(data).decode()}'


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined  # noqa: PLC0415 (not confined)

    return Environment(
        loader=PackageLoader('barc_sim.lab', 'pages'),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
