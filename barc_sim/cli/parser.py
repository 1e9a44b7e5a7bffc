"""What the commands share: a parser, types of options, suggestions, and error messages.

`call` prints an error as one sentence. A UserError has its sentence already. Errors of the system
(files, memory, threads) get theirs here; every other error is a bug, and keeps its traceback.
"""

from __future__ import annotations

import argparse
import errno
import io
import os
import shlex
import shutil
import sys
from contextlib import contextmanager, suppress
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from barc_sim.cli.limits import not_between
from barc_sim.cli.process import ROS_PACKAGES, needs_ros
from barc_sim.errors import UserError, escaped

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

ROS_ARGS = '--ros-args'
_ROS_ARGS_HELP = (
    'Arguments after --ros-args go to ROS: -p NAME:=VALUE sets a parameter, -r __ns:=/car2 moves '
    'the nodes into a namespace.'
)
MAX_PORT = 65_535
USAGE_ERROR = 2
INTERRUPTED = 130
_USUAL_COLUMNS = 80  #: of a terminal that gives no size, such as a serial line
_MARGIN = 2  #: columns that argparse leaves free
#: The names under which packages are installed, where these differ.
_DISTRIBUTIONS = {'PIL': 'pillow', 'yaml': 'pyyaml'}
#: Errors of writing to the standard output.
_OF_OUTPUT = (errno.EPIPE, errno.ENOSPC, errno.EFBIG, errno.EIO, errno.EBADF)


class Parser(argparse.ArgumentParser):
    """An ArgumentParser whose errors are one line; `--help` shows the rest."""

    _usual: frozenset[str] = frozenset()

    def __init__(self, **options: Any) -> None:  # noqa: ANN401 (ArgumentParser's own)
        """Accept only whole names of options: a shortened one could mean another option."""
        formatter_class: Callable[..., argparse.HelpFormatter] = options.pop(
            'formatter_class', argparse.HelpFormatter
        )

        def formatter(prog: str) -> argparse.HelpFormatter:
            return formatter_class(prog, width=columns() - _MARGIN)

        super().__init__(formatter_class=formatter, allow_abbrev=False, **options)

    def shorten_help(self, *usual: str) -> None:
        """Let `--help` show only the `usual` options, and `--help-all` every option."""
        self._usual = frozenset({'--help', '--help-all', *usual})
        self.add_argument('--help-all', action=_HelpAll, nargs=0, help='show every option')

    def format_help(self) -> str:
        """Return the help; after `shorten_help`, only of the usual options."""
        if not self._usual:
            return super().format_help()

        rare_actions = [
            action for action in self._actions if self._usual.isdisjoint(action.option_strings)
        ]
        usage = self.usage
        epilog = self.epilog
        texts = [action.help for action in rare_actions]

        self.usage = '%(prog)s [OPTION...]'
        self.epilog = None
        for action in rare_actions:
            action.help = argparse.SUPPRESS
        try:
            return super().format_help()
        finally:
            self.usage = usage
            self.epilog = epilog
            for action, text in zip(rare_actions, texts, strict=True):
                action.help = text

    def parse_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> argparse.Namespace:
        """Parse as ArgumentParser does; suggest similar options for an unknown one."""
        options, unknown = self.parse_known_args(args, namespace)
        if unknown:
            self._refuse(unknown[0].partition('=')[0])
        return options

    def _refuse(self, word: str) -> NoReturn:
        """Exit because of an unknown option or argument."""
        names = [option.removeprefix('--') for option in self._option_string_actions]
        suggestion = did_you_mean(word.removeprefix('--'), names, '--')
        problem = 'there is no option' if word.startswith('-') else 'unexpected argument'
        self.error(f'{problem} {word!r}{suggestion}')

    def error(self, message: str) -> NoReturn:
        """Print `message` on stderr in one line and exit with code 2."""
        self.exit(USAGE_ERROR, escaped(f'{error_line(self.prog, message)} (see --help)\n'))


class _HelpAll(argparse.Action):
    """Prints the help of every option, and exits."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        print(argparse.ArgumentParser.format_help(parser), end='')  # noqa: T201
        parser.exit()


def columns() -> int:
    """Return how many columns the terminal has, or is taken to have."""
    # Python 3.10 returns 0 for a terminal that gives no size.
    return shutil.get_terminal_size().columns or _USUAL_COLUMNS


def accept_ros_args(parser: argparse.ArgumentParser) -> None:
    """Let the command line end with `--ros-args …`, which becomes `options.ros_args`."""
    parser.set_defaults(ros_args=[])
    parser.epilog = f'{parser.epilog or ""} {_ROS_ARGS_HELP}'.strip()


def add_bag(parser: argparse.ArgumentParser) -> None:
    """Add the bag to read."""
    parser.add_argument(
        'bag',
        nargs='?',
        type=Path,
        metavar='BAG',
        help='its directory, or a file of it (the newest in ./bags)',
    )


def add_bag_arguments(parser: argparse.ArgumentParser, *, several: bool = False) -> None:
    """Add the bag, or `several`, to read and, in it, the car."""
    if several:
        parser.add_argument(
            'bags',
            nargs='*',
            type=Path,
            metavar='BAG',
            help='its directory, or a file of it (the newest in ./bags); several are compared',
        )
    else:
        add_bag(parser)

    parser.add_argument(
        '--namespace', metavar='NS', help='the car, if the bag has several, as in /car1'
    )


def number(low: float, high: float) -> Callable[[str], float]:
    """Return a converter from text to a number between `low` and `high`, ends included."""
    return lambda text: float(_between(text, float(low), high))


def whole(low: float, high: float = inf) -> Callable[[str], int]:
    """Return a converter from text to a whole number between `low` and `high`, ends included."""
    return lambda text: int(_between(text, low, high))


def _between(text: str, low: float, high: float) -> float | str:
    """Return the number in `text`, if it is within the limits."""
    value: float | str = text
    for kind in (float, int):
        with suppress(ValueError):
            value = kind(text)

    problem = not_between(value, low, high)
    if problem:
        raise argparse.ArgumentTypeError(problem)
    return value


def did_you_mean(name: str, names: Iterable[str], prefix: str = '') -> str:
    """Return the end of a sentence with the `names` closest to `name`, or ''.

    `prefix` precedes each of them.
    """
    from difflib import get_close_matches  # noqa: PLC0415 (only for an error)

    matches = [prefix + match for match in get_close_matches(name, names)]
    return f': did you mean {" or ".join(matches)}?' if matches else ''


def barc_path() -> str:
    """Return the command `barc` as a user can type it in this shell and directory."""
    # Under colcon, for example, there is no such program.
    return program_path('barc') or f'{_quoted(Path(sys.executable))} -m barc_sim'


def program_path(name: str) -> str | None:
    """Return a program of this environment as a user can type it here; None: there is none."""
    program = Path(sys.executable).with_name(name)
    if not program.exists():
        return None

    program_on_path = shutil.which(name)
    if program_on_path and program.samefile(program_on_path):
        return name
    return _quoted(program)


def _quoted(path: Path) -> str:
    with suppress(ValueError):
        path = path.relative_to(Path.cwd())
    return shlex.quote(str(path))


def call(prog: str, main: Callable[[], int | None]) -> int:
    """Run `main` and return the command's exit code.

    A UserError or an error of the system becomes one line on stderr and code 2; Ctrl-C becomes
    code 130. A closed pipe (`| head`) ends the command silently. Characters that stdout's encoding
    lacks are printed as `?`.
    """
    try:
        _open_streams()
        with _flushed():
            return main() or 0
    except KeyboardInterrupt:
        return INTERRUPTED
    except Exception as error:
        message = _sentence(error, prog)
        if message is None:
            raise

    if not message:
        return 0
    report(prog, message)
    return USAGE_ERROR


def show(text: object, *, end: str = '\n', error: bool = False) -> None:
    """Print `text` on stdout, or on stderr; characters that control a terminal become escapes.

    Use it in place of `print` for any text that a bag, a file or another process may have chosen.
    """
    print(escaped(str(text)), end=end, file=sys.stderr if error else None, flush=True)


def report(prog: str, message: str) -> None:
    """Print an error of the program `prog` on stderr, in one line."""
    show(error_line(prog, message), error=True)


def warn(message: str) -> None:
    """Print a warning on stderr, in one line."""
    show(f'warning: {" ".join(message.splitlines())}', error=True)


def error_line(prog: str, message: str) -> str:
    """Return the line for an error of the program `prog`."""
    return f'{prog}: error: {" ".join(message.splitlines())}'


def check_arguments(words: Sequence[str]) -> None:
    """Raise UserError for an argument that is not UTF-8: neither ROS nor a bag can hold it."""
    for word in words:
        if word.encode(errors='replace').decode() != word:
            raise UserError(
                f'the argument {word!r} is not UTF-8: rename the file, or type the name again'
            )


def _open_streams() -> None:
    """Replace the standard streams that a shell has closed."""
    for name, mode in (('stdin', 'r'), ('stdout', 'w'), ('stderr', 'w')):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode, encoding='utf-8'))  # noqa: SIM115


@contextmanager
def _flushed() -> Iterator[None]:
    """Allow any character in stdout, and flush it at the end, where a failure can be caught."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors='replace')
    try:
        yield
    finally:
        sys.stdout.flush()


def _sentence(error: Exception, prog: str) -> str | None:
    """Return an error's sentence; '' for a closed pipe, None for a bug of barc_sim."""
    sentence = None
    if isinstance(error, UserError):
        sentence = str(error)
    elif isinstance(error, MemoryError):
        sentence = 'there is not enough memory: end other programs, or raise the limit (ulimit -v)'
    elif isinstance(error, ModuleNotFoundError):
        sentence = _missing(error, prog)
    elif isinstance(error, OSError):
        sentence = _refused(error)
    elif str(error).startswith('Key backend: '):  # Matplotlib's, if imported
        name = os.environ.get('MPLBACKEND')
        sentence = f'MPLBACKEND is {name!r}, which Matplotlib does not have: unset it'
    elif str(error).startswith('Symlink loop'):  # pathlib's, before Python 3.13
        sentence = f'{error}: name another file'
    elif type(error).__name__ == 'RCLError':  # importing it would import ROS
        sentence = f'ROS failed: {str(error).partition(", at ")[0]}'
    return sentence


def _refused(error: OSError) -> str:
    """Return the sentence for an error of the system: of a file, or of the output."""
    if error.filename is not None:
        name = os.fsdecode(error.filename) if error.filename else ''
        return f'{name!r} cannot be used ({error.strerror}): name another'
    if error.errno not in _OF_OUTPUT:
        return f'the system refuses to continue: {error.strerror or error}'

    # Python flushes stdout once more at exit: redirect that to nowhere.
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    if isinstance(error, BrokenPipeError):
        return ''
    return f'the output cannot be written: {error.strerror}'


def _missing(error: ModuleNotFoundError, prog: str) -> str | None:
    """Return the sentence for a missing package; None for a module of barc_sim."""
    package = (error.name or '').partition('.')[0]
    if package in ROS_PACKAGES:
        return str(needs_ros(prog))
    if package in ('', 'barc_sim'):
        return None

    python = shlex.quote(sys.executable)
    distribution = shlex.quote(_DISTRIBUTIONS.get(package, package))
    return (
        f'the package {package!r} is not installed in this Python: run '
        f'{python} -m pip install {distribution}'
    )
