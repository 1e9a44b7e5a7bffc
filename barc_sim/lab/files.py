"""Lists the files of each lab, finds them in a folder, and reads them without loading them.

Reading a user's file gives its syntax errors, its gains, and whether it is a ROS program. How the
parts are judged is in `labs/`; the points are in `grade/rubrics/`.

To find its gains, `find_gains` evaluates assignments and the arguments of `PID(…)`, with almost no
built-in names. These few names keep it from side effects by accident; they are no protection
against code that looks for a way out. It is safe for another reason: only `UserCode.gains` calls
it, for a file that the same process has already loaded. In `grade` that is the confined process of
the submission; elsewhere it is a process whose user chose to run the file. So the expressions can
do nothing that the file could not do while it was loaded.
"""

from __future__ import annotations

import ast
import io
import re
import shlex
import sys
import tokenize
import warnings
from contextlib import suppress
from enum import Enum
from importlib import resources
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from barc_sim.cli.files import read_regular
from barc_sim.cli.text import one_line
from barc_sim.errors import UserError
from barc_sim.lab.f_strings import without_f_strings

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping
    from inspect import BoundArguments, Signature
    from types import CodeType

_T = TypeVar('_T')
#: The script of Task 3 of the hills lab: a student runs it; it is not judged.
COMPOSE = 'compose.py'
#: The file beside a report for the points and comments that a person enters.
BY_HAND = 'by_hand.yaml'
MAX_SOURCE = 1_000_000  #: bytes
_SHOWN = 120  #: maximum length of a wrong line in a message
_INDENTATION = re.compile(r'^[ \t]+', re.MULTILINE)
_NO_CALL_OF_PRINT = "call to 'print'"  # part of Python's message on a print statement
_MAX_PRINTS = 200  # print statements of Python 2 that are read in a file
#: The default gains of PID in the lab's template: they do not count as chosen.
_TEMPLATE = (1.0, 1.0, 1.0)
_MAX_GAIN = 1e12
GAINS = ('kp', 'ki', 'kd')  #: of a PID
_KEY_READERS = {
    *('curses', 'getch', 'getkey', 'keyboard', 'msvcrt', 'pygame', 'pynput', 'readchar', 'termios'),
    *('tkinter', 'Tkinter', 'tty'),
}
_RELAY_TOPIC = 'cmd_vel'
_INPUTS = {'sys.stdin', 'input()', 'raw_input()'}


class Called(NamedTuple):
    """The signature of a user's function, class or method that barc_sim calls.

    For example, `Called('relay', '', method='relay', is_main=True)` is a class in `relay.py` whose
    constructor takes no arguments. Its objects have a method `relay`, with a signature of its own
    in the same table. Where a law judges a function, the names in `takes` are quantities of this
    law: its values are the arguments, in this order.
    """

    part: str  #: its file, see `FILES`
    takes: str | None  #: the names of its arguments, with spaces between; '': none, None: any
    numbers: int = 0  #: how many numbers it returns; 0: an object, of which no number is read
    returns: str = 'an object'  #: what it returns, in words for messages
    method: str = ''  #: of a class: the method that is called, another name in the same table
    is_timed: bool = False  #: whether it may also take the time step `dt`
    #: Whether it is one of the names to look for in its file: the file must define one of them.
    is_main: bool = False


class Handout(NamedTuple):
    """The templates of a lab, and the files that a student hands in."""

    folder: str  #: of its templates, and the name of its module in `labs`
    files: Mapping[str, str]  #: the files that are loaded and judged, by part
    called: Mapping[str, Called]  #: the functions, classes and methods of these files, by name
    rubric: str  #: the name of its rubric
    drive: str  #: the command that drives with a folder, without the folder's name
    others: tuple[str, ...] = ()  #: more files to write

    @property
    def written(self) -> str:
        """The names of the files that a student writes."""
        return ', '.join((*self.files.values(), *self.others))

    def templates(self) -> dict[str, bytes]:
        """Return the files that a student starts with, by name."""
        folder = resources.files('barc_sim.lab') / 'templates' / self.folder
        names = ('README.md', *self.files.values(), *self.others)
        return {name: (folder / name).read_bytes() for name in names}


_STATE = 'four finite numbers, [x_next, y_next, psi_next, v_next]'
HILLS = Handout(
    folder='hills',
    files={'model': 'bike_model.py', 'controller': 'controller.py', 'relay': 'relay.py'},
    called={
        'bikeFE': Called('model', 'x y psi v a d_f a0 m Ff theta ts', 4, _STATE, is_main=True),
        'PID': Called('controller', 'kp ki kd', method='acc_calculate', is_main=True),
        'acc_calculate': Called(
            'controller',
            'speed_reference speed_current',
            1,
            'a finite number, the acceleration [m/s²]',
            is_timed=True,
        ),
        'Relay': Called('relay', '', method='relay', is_main=True),
        'relay': Called(
            'relay',
            'linear_x angular_z',
            2,
            'two finite numbers, [motor, servo]',
            is_timed=True,
            is_main=True,
        ),
    },
    rubric='lab',
    drive='acc --lab',
    others=(COMPOSE,),
)
_ERRORS = 'two finite numbers, [e_y, e_psi]'
LANE = Handout(
    folder='lane',
    files={'lane': 'lane.py'},
    called={
        'Lane': Called('lane', None, method='steer_calculate', is_main=True),
        'steer_calculate': Called(
            'lane', 'e_y e_psi speed curvature', 1, 'a finite number, the steering angle [rad]'
        ),
        'straight_errors': Called('lane', 'x y psi x_0 y_0 psi_0', 2, _ERRORS),
        'arc_errors': Called('lane', 'x y psi x_c y_c radius', 2, _ERRORS),
        'steady': Called('lane', 'curvature', 2, 'two finite numbers, [delta, e_psi]'),
    },
    rubric='lane',
    drive='acc --track L --speed 6 --laps 3 --dynamics dynamic --lab',
)
POINTS = 120  #: of a track, in `raceline.py`
_MODEL = 'six finite numbers, [a11, a12, a21, a22, b1, b2]'
_PROGRAM = '110 finite numbers, np.append(H, g)'  # H is 10 x 10, g has 10
RACELINE = Handout(
    folder='raceline',
    files={'raceline': 'raceline.py'},
    called={
        'profile': Called('raceline', 'curvatures step', POINTS, f'{POINTS} finite speeds [m/s]'),
        'line': Called(
            'raceline',
            'x y psi half',
            POINTS,
            f'{POINTS} finite numbers, offsets [m]',
            is_main=True,
        ),
        'predict': Called('raceline', 'speed', 6, _MODEL),
        'program': Called('raceline', 'e_y e_psi speed', 110, _PROGRAM),
    },
    rubric='raceline',
    drive='acc --track L --speed-profile 3.5 2 --speed 12 --laps 3 --dynamics dynamic --lab',
)
_ESTIMATE = 'six finite numbers, [drag, …, delay_interval]'
IDENTIFY = Handout(
    folder='identify',
    files={'identify': 'identify.py'},
    called={
        'command': Called(
            'identify', 't', 1, 'a finite number, the acceleration [m/s²]', is_main=True
        ),
        'estimate': Called('identify', 't v a', 6, _ESTIMATE),
    },
    rubric='identify',
    drive='acc --road flat --distance 0 --lab',
)
#: By the value of `barc new --lab`; `barc_sim/lab/__init__.py` lists the other names of each lab.
HANDOUTS = {'hills': HILLS, '3': LANE, '4': RACELINE, '5': IDENTIFY}


def united(tables: Iterable[Mapping[str, _T]]) -> dict[str, _T]:
    """Return the entries of several tables in one; a ValueError if two have the same key.

    Parts, functions and criteria are looked up without their lab. So a name must be unique over all
    labs: a second function `profile` would replace the first one without a word.
    """
    entries: dict[str, _T] = {}
    for table in tables:
        common = sorted(entries.keys() & table.keys())
        if common:
            raise ValueError(f'{common[0]!r} is in two labs: choose another name in one of them')
        entries.update(table)
    return entries


#: The file of each part of any lab.
FILES = united(each.files for each in HANDOUTS.values())
RUBRICS = tuple(each.rubric for each in HANDOUTS.values())
_POLICY = {'policy': Called('policy', 'observation', returns='a list of actions', is_main=True)}
#: The functions, classes and methods of user files that barc_sim calls, of any lab or of a policy.
CALLED = united([*(each.called for each in HANDOUTS.values()), _POLICY])


def main_names(part: str) -> list[str]:
    """Return the names to look for in the file of a part; the first one that it has is used."""
    return [name for name, called in CALLED.items() if called.part == part and called.is_main]


def handout_of(parts: Collection[str]) -> Handout:
    """Return the lab of a folder with these parts: the lab with the largest share of its parts."""
    return max(
        HANDOUTS.values(),
        key=lambda each: len(each.files.keys() & set(parts)) / len(each.files),
    )


def names_of(names: Collection[str], parts: Collection[str] = tuple(FILES)) -> dict[str, str]:
    """Return those `names` that are files of `parts`, by part; see `find_name`."""
    by_part = {}
    for part in parts:
        name = find_name(names, part)
        if name:
            by_part[part] = name
    return by_part


def files_in(folder: Path, parts: Collection[str] = tuple(FILES)) -> dict[str, Path]:
    """Return the files of `parts` in `folder`, by part; see `find_name`."""
    names = [file.name for file in folder.glob('*.py') if file.exists()]
    return {part: folder / name for part, name in names_of(names, parts).items()}


def find_files(folder: Path, parts: Collection[str] = tuple(FILES)) -> dict[str, Path]:
    """Return the files of `parts` in `folder`, at least one; else a UserError."""
    if folder.is_file():
        raise UserError(f'{str(folder)!r} is a file: name the folder that it is in')
    if not folder.is_dir():
        raise UserError(
            f'there is no folder {str(folder)!r}: name the one with your files; '
            f'barc new {shlex.quote(str(folder))} writes one'
        )
    files = files_in(folder, parts)
    if files:
        return files
    names = ', '.join(FILES[part] for part in parts)
    raise UserError(f'the folder {str(folder)!r} has no {names}: expected at least one of them')


def find_name(names: Collection[str], part: str) -> str | None:
    """Return the name of a part's file among `names`, or the only similar name.

    Similar names are `Bike_Model.py`, `bike_model_final(1).py` and `my_bike_model.py`.
    """
    if FILES[part] in names:
        return FILES[part]
    stem = _letters(Path(FILES[part]).stem)
    similar = []
    for name in names:
        if name.endswith('.py') and '/' not in name:
            letters = _letters(name[:-3])
            if letters.startswith(stem) or letters.endswith(stem):
                similar.append(name)
    return similar[0] if len(similar) == 1 else None


def candidates(files: Mapping[str, bytes], part: str) -> list[str]:
    """Return the files at the top that could be the file of a part under a name of their own.

    They define what the file of the part must define, or use the topic of a relay. They are not
    judged: only the student knows whether they are meant. The files are not parsed, because the
    grader itself calls this.
    """
    names = '|'.join(main_names(part))
    has_definition = re.compile(rf'^(def|class) +({names})\b', re.MULTILINE)
    others = {name for each in HANDOUTS.values() for name in each.others}
    similar = []
    for name, data in sorted(files.items()):
        if '/' in name or not name.endswith('.py') or name in others:
            continue
        is_taken = any(find_name([name], each) for each in FILES)
        text = data.decode(errors='replace')
        is_similar = has_definition.search(text) or (part == 'relay' and _RELAY_TOPIC in text)
        if is_similar and not is_taken:
            similar.append(name)
    return similar


def missing(handout: Handout, part: str, files: Mapping[str, bytes]) -> str:
    """Return the sentence on a part whose file is missing, with the files that could be it."""
    sentence = f'there is no {handout.files[part]}'
    names = candidates(files, part)
    if names:
        sentence += f': is it {" or ".join(names)}? Then give it this name'
    return sentence


def _letters(name: str) -> str:
    return ''.join(filter(str.isalpha, name.lower()))


class ErrorKind(Enum):
    """The kinds of errors in user code that more follows from than a message.

    Only barc_sim chooses the kind. What a program raises or prints can have any words, so no text
    is searched for them.
    """

    NOT_WRITTEN = 'not written'  #: a function is still the template's
    READS_KEYS = 'reads keys'  #: a relay that is a program with a keyboard of its own
    NEEDS_PYTHON = 'needs Python'  #: a file that only a later Python can read
    ENDLESS = 'endless loop'  #: a call that has used up its time limit
    OTHER = 'other'

    @property
    def needs_person(self) -> bool:
        """Whether a person judges the code, because it cannot be judged here."""
        return self in {ErrorKind.READS_KEYS, ErrorKind.NEEDS_PYTHON}


class UserCodeError(UserError):
    """An error in user code, as one sentence: file, line, values, what was expected.

    An exception of the user code is its `__cause__`.
    """

    def __init__(self, message: str = '', kind: ErrorKind = ErrorKind.OTHER) -> None:
        """Make an error of a kind."""
        super().__init__(message)
        self.kind = kind


class Source(NamedTuple):
    """A user's file, as it was loaded."""

    name: str  #: path in the user's folder
    path: Path
    text: str
    data: bytes  #: as it is on the disk


def read_source(path: Path, name: str) -> Source:
    """Read the file at `path`; a UserCodeError if it cannot be read, or is not text.

    Its encoding is found by Python's rules: a byte order mark, a coding line, else UTF-8.
    """
    try:
        data = read_regular(path, MAX_SOURCE)
    except OSError as error:
        raise UserCodeError(f'{str(path)!r} cannot be read: {error.strerror}') from error
    return Source(name, path, _decoded(data, name), data)


def _decoded(data: bytes, name: str) -> str:
    """Return the text of a file of Python."""
    encoding = 'utf-8'
    try:
        encoding, _ = tokenize.detect_encoding(io.BytesIO(data).readline)
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        line = data.count(b'\n', 0, error.start) + 1
        raise _not_text(data[error.start], f'{name}, line {line}', encoding) from error
    except (SyntaxError, LookupError, ValueError) as error:
        try:
            data.decode()
        except UnicodeDecodeError as wrong:
            line = data.count(b'\n', 0, wrong.start) + 1
            raise _not_text(data[wrong.start], f'{name}, line {line}', 'utf-8') from error
        raise UserCodeError(f'{name}: {error}: save the file in the encoding UTF-8') from error
    return io.IncrementalNewlineDecoder(None, translate=True).decode(text, final=True)


def _not_text(byte: int, at: str, encoding: str) -> UserCodeError:
    shown = 'UTF-8' if encoding.startswith('utf-8') else encoding
    return UserCodeError(
        f'{at}: the byte 0x{byte:02x} is not {shown}: save the file in the encoding UTF-8'
    )


class Compiled(NamedTuple):
    """A compiled file."""

    code: CodeType
    tree: ast.Module
    tolerated: tuple[str, ...] = ()  #: faults that cost nothing, a phrase each


def compiled(source: Source) -> Compiled:
    """Compile a source of Python 3.

    Two faults of older files are tolerated: mixed tabs are expanded to multiples of 8 spaces, and
    the print statements of Python 2 are read as calls.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            tree, tolerated = _parsed(source)
            code = compile(tree, str(source.path), 'exec', dont_inherit=True)
    except SyntaxError as error:
        raise _syntax_error(source, error) from error
    except (ValueError, RecursionError, MemoryError) as error:
        raise UserCodeError(f'{source.name} is not Python 3: {error}') from error
    return Compiled(code, tree, tolerated)


def _parsed(source: Source) -> tuple[ast.Module, tuple[str, ...]]:
    """Return the syntax tree of a source, and what is tolerated in it, a phrase each."""
    text = source.text
    phrases: dict[str, str] = {}  # by fault: each is named once
    for _ in range(_MAX_PRINTS):
        try:
            return ast.parse(text, source.name), tuple(phrases.values())
        except TabError:  # noqa: PERF203 (each turn mends a line)
            text = _INDENTATION.sub(lambda match: match[0].expandtabs(8), text)
            phrases['tabs'] = 'tabs and spaces are mixed: a tab counts as 8 spaces'
        except SyntaxError as error:
            statement = _print_statement(text, error)
            if not statement:
                raise
            text = statement.before + statement.call + statement.after
            advice = f'print is a function in Python 3: write {one_line(statement.call)}'
            phrases.setdefault('print', advice)
    return ast.parse(text, source.name), tuple(phrases.values())


class _PrintStatement(NamedTuple):
    """A print statement of Python 2 in a text."""

    before: str  #: the text before it
    call: str  #: the same in Python 3
    after: str


def _print_statement(text: str, error: SyntaxError) -> _PrintStatement | None:
    """Return the print statement of Python 2 that has raised an error; None if it is another."""
    if _NO_CALL_OF_PRINT not in error.msg or not (error.lineno and error.offset):
        return None
    lines = io.StringIO(text).readlines()
    line = lines[error.lineno - 1]
    before = ''.join(lines[: error.lineno - 1]) + line[: error.offset - 1]
    rest = text[len(before) :]
    if not rest.startswith('print'):
        return None

    end = _end_of_statement(rest)
    values = rest[len('print') : end].strip()
    call = f'print({values})'
    if values.endswith(','):  # no new line
        call = f"print({values} end=' ')"
    return _PrintStatement(before, call, rest[end:])


def _end_of_statement(text: str) -> int:
    """Return the length of the statement with which a text begins, without a comment."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    row = 1
    column = 0
    with suppress(tokenize.TokenError, SyntaxError):  # of what comes after it
        for token in tokens:
            if token.type in {tokenize.NEWLINE, tokenize.COMMENT} or token.string == ';':
                break
            row, column = token.end
    lines = io.StringIO(text).readlines()
    return len(''.join(lines[: row - 1])) + column


_HERE = '.'.join(map(str, sys.version_info[:2]))
#: Syntax of later versions of Python: the first version that has it, and what it is.
_LATER = (
    ((3, 11), re.compile(r'except\s*\*'), 'except*'),
    ((3, 12), re.compile(r'type\s+\w+\s*(\[.*\]\s*)?='), 'a type statement'),
    ((3, 12), re.compile(r'(async\s+)?(def|class)\s+\w+\s*\['), 'a type parameter'),
)
_F_STRINGS = (3, 12)  #: the version since which an f-string can contain its own quotes


def _later_syntax(source: Source, error: SyntaxError) -> str:
    """Return what a file has that only a later Python can read, with the version; empty if none."""
    line = (error.text or '').strip()
    for version, pattern, what in _LATER:
        if sys.version_info < version and pattern.match(line):
            return f'{what} needs Python {version[0]}.{version[1]}'
    if sys.version_info >= _F_STRINGS:
        return ''
    with suppress(SyntaxError, ValueError, RecursionError, MemoryError):
        ast.parse(without_f_strings(source.text))
        return f'this f-string needs Python {_F_STRINGS[0]}.{_F_STRINGS[1]}'
    return ''


def _syntax_error(source: Source, error: SyntaxError) -> UserCodeError:
    text = (error.text or '').strip()[:_SHOWN]
    at = f'{source.name}, line {error.lineno or 1}'

    later = _later_syntax(source, error)
    if later:
        return UserCodeError(
            f'{at}: {later}, and this machine has {_HERE}: run it with a later one',
            ErrorKind.NEEDS_PYTHON,
        )

    return UserCodeError(f'{at}: syntax error: {error.msg}' + (f': {text}' if text else ''))


def guarded_imports(tree: ast.Module) -> set[str]:
    """Return the modules that a file imports in a `try`: it can run without them."""
    return {
        name.partition('.')[0]
        for node in ast.walk(tree)
        if isinstance(node, ast.Try) and node.handlers
        for part in node.body
        for name in _imports(part)
    }


def ros_of_program(tree: ast.Module) -> str:
    """Return `rclpy` or `rospy` if a file is a program that uses it, else an empty string.

    A file that defines a function or method `relay` of two arguments is no program, even if it
    imports ROS: barc_sim's node calls its `relay`.
    """
    for node in tree.body:
        parts = node.body if isinstance(node, ast.ClassDef) and node.name == 'Relay' else [node]
        for part in parts:
            if isinstance(part, ast.FunctionDef) and part.name == 'relay':
                arguments = [each.arg for each in part.args.args if each.arg != 'self']
                if arguments[1:] or part.args.vararg:
                    return ''
    imported = {name.partition('.')[0] for node in ast.walk(tree) for name in _imports(node)}
    for ros in ('rclpy', 'rospy'):
        if ros in imported:
            return ros
    return ''


def key_reader(tree: ast.Module) -> str:
    """Return the module or function with which a file reads keys; empty if it reads none."""
    inputs = set()
    for node in ast.walk(tree):
        for name in _imports(node):
            module = name.partition('.')[0]
            if module in _KEY_READERS:
                return module
        if isinstance(node, ast.Attribute):
            inputs.add(ast.unparse(node))
        elif isinstance(node, ast.Call):
            inputs.add(f'{ast.unparse(node.func)}()')
    return min(inputs & _INPUTS, default='')


def _imports(node: ast.AST) -> list[str]:
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom) and not node.level:
        return [node.module or '']
    return []


class ChosenGains(NamedTuple):
    """The gains that a user's file chooses, and the line that does so."""

    kp: float
    ki: float
    kd: float
    origin: str  #: such as 'controller.py, line 65'

    @property
    def values(self) -> tuple[float, float, float]:
        """The gains, in the order of `GAINS`."""
        return self.kp, self.ki, self.kd

    def __str__(self) -> str:
        """Return the gains and their origin as text."""
        return f'kp {self.kp:g}, ki {self.ki:g}, kd {self.kd:g} ({self.origin})'


def find_gains(tree: ast.Module, file: str, new: Signature, place: str) -> ChosenGains | None:
    """Return the gains that a user has chosen in `file`, from its syntax tree.

    They come from the last call `PID(…)` with numbers and constants. Without such a call they are
    the defaults of the constructor `new`, defined at `place`, unless these are the template's.
    """
    nodes = sorted(ast.walk(tree), key=lambda node: getattr(node, 'lineno', 0))
    names = GAINS if {*GAINS} <= {*new.parameters} else [*new.parameters][: len(GAINS)]
    constants = _constants(nodes)
    for node in reversed(nodes):
        if isinstance(node, ast.Call) and _is_pid(node):
            with suppress(Exception):  # the arguments are not constants
                bound = _bound_arguments(node, new, constants)
                is_chosen = not bound.arguments.keys().isdisjoint(names)
                bound.apply_defaults()
                gains = _gains(map(bound.arguments.get, names), f'{file}, line {node.lineno}')
                if is_chosen:
                    return gains

    with suppress(TypeError, ValueError):  # there are no defaults
        gains = _gains((new.parameters[name].default for name in names), f'defaults, {place}')
        return None if gains.values == _TEMPLATE else gains
    return None


def _few_names() -> dict[str, Any]:
    """Return the built-in names in expressions of user files; see the top of this module."""
    return {'__builtins__': {'dict': dict, 'float': float}}


def _constants(nodes: Iterable[ast.AST]) -> dict[str, Any]:
    """Return the constants that a file assigns, by name, also to attributes of `self`."""
    constants: dict[str, Any] = {'self': SimpleNamespace()}
    for node in nodes:
        if isinstance(node, ast.Assign):
            with suppress(Exception):  # the value is not a constant
                exec(compile(ast.Module([node], []), '', 'exec'), _few_names(), constants)  # noqa: S102
    return constants


def _is_pid(call: ast.Call) -> bool:
    """Return whether a call is one of `PID`, also as an attribute of a module."""
    return 'PID' in (getattr(call.func, 'id', ''), getattr(call.func, 'attr', ''))


def _bound_arguments(
    call: ast.Call, new: Signature, constants: Mapping[str, Any]
) -> BoundArguments:
    """Return the arguments of a call of `new`, computed from constants."""
    expression = ast.Expression(ast.Call(ast.Name('PID', ast.Load()), call.args, call.keywords))
    code = compile(ast.fix_missing_locations(expression), '', 'eval')
    bound: BoundArguments = eval(code, _few_names(), {**constants, 'PID': new.bind})  # noqa: S307
    return bound


def _gains(values: Iterable[Any], origin: str) -> ChosenGains:
    kp, ki, kd = map(float, values)
    if not max(map(abs, (kp, ki, kd))) <= _MAX_GAIN:  # true for NaN, too
        raise ValueError('too large for a gain')
    return ChosenGains(kp, ki, kd, origin)
