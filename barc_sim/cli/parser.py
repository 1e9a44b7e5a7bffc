"""What the commands share: a parser, one-line errors, exit codes, and the path of `barc`."""

from __future__ import annotations

import argparse
import io
import os
import re
import shlex
import sys
import sysconfig
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from barc_sim.cli.ros_hint import ROS_PACKAGES, has_ros, needs_ros
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

#: By package, the name to install it by, where that is another.
_DISTRIBUTIONS = {'PIL': 'pillow', 'yaml': 'pyyaml'}
ROS_ARGS = '--ros-args'
_ROS_ARGS_HELP = (
    'Arguments after --ros-args go to ROS, for example '
    '--ros-args -r __ns:=/car2 -p controller:acceleration_limit:=4.0'
)
USAGE_ERROR = 2
INTERRUPTED = 130


class Parser(argparse.ArgumentParser):
    """An ArgumentParser whose errors are one line; `--help` shows the rest."""

    def __init__(self, *arguments: Any, **options: Any) -> None:  # noqa: ANN401
        """Take what ArgumentParser takes; `-1e-3` is a number, as it is from Python 3.14 on."""
        super().__init__(*arguments, **options)
        self._negative_number_matcher = re.compile(
            r'-(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$', re.IGNORECASE
        )

    def parse_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> argparse.Namespace:
        """Parse as ArgumentParser does; for an unknown option, suggest those that are close."""
        options, unknown = self.parse_known_args(args, namespace)
        if unknown:
            name = unknown[0].partition('=')[0].removeprefix('--')
            known = (each.removeprefix('--') for each in self._option_string_actions)
            close = did_you_mean(name, known, '--')
            self.error(f'unrecognized arguments: {" ".join(unknown)}{close}')
        return options

    def error(self, message: str) -> NoReturn:
        """Print `message` on stderr in one line and exit with code 2."""
        self.exit(USAGE_ERROR, f'{_error_line(self.prog, message)} (see --help)\n')


def accept_ros_args(parser: argparse.ArgumentParser) -> None:
    """Let the command line end with `--ros-args …`, which becomes `options.ros_args`."""
    parser.set_defaults(ros_args=[])
    parser.epilog = f'{parser.epilog or ""} {_ROS_ARGS_HELP}'.strip()


def add_bag_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the bag to read and, in it, the car."""
    parser.add_argument(
        'bag', nargs='?', type=Path, metavar='BAG', help='default: the newest in ./bags'
    )
    parser.add_argument(
        '--namespace', metavar='NS', help='the car, in a bag of several, as in /car1'
    )


def did_you_mean(name: str, known: Iterable[str], prefix: str = '') -> str:
    """Return the end of a sentence with the names in `known` closest to `name`, or ''.

    Each is printed behind `prefix`.

    Examples
    --------
    >>> did_you_mean('kpp', ['kp', 'ki', 'kd'])
    ': did you mean kp?'
    """
    from difflib import get_close_matches  # noqa: PLC0415 (only for an error)

    close = [prefix + each for each in get_close_matches(name, known)]
    return f': did you mean {" or ".join(close)}?' if close else ''


def barc_path() -> str:
    """Return `barc` as it can be typed in this shell and directory, quoted."""
    program = Path(sys.executable).with_name('barc')
    for folder in map(Path, os.get_exec_path()):
        if (folder / 'barc').exists():
            if (folder / 'barc').samefile(program):
                return 'barc'
            break
    if not program.exists():  # under colcon, for one
        return f'{_quoted(Path(sys.executable))} -m barc_sim'
    return _quoted(program)


def _quoted(path: Path) -> str:
    with suppress(ValueError):
        path = path.relative_to(Path.cwd())
    return shlex.quote(str(path))


def call(prog: str, main: Callable[[], int | None]) -> int:
    """Run `main` and return the command's exit code.

    A UserError becomes one line on stderr and code 2, so does a Python without ROS; Ctrl-C becomes
    code 130. A closed pipe (`| head`) ends the command silently. What stdout's encoding lacks is
    printed as `?`.
    """
    try:
        return _print_all(main)
    except UserError as error:
        report(prog, str(error))
        return USAGE_ERROR
    except ImportError as error:
        missing = _missing(error, prog)
        if missing is None:
            raise
        report(prog, missing)
        return USAGE_ERROR
    except KeyboardInterrupt:
        return INTERRUPTED
    except OSError as error:
        if error.filename:
            raise
        if sys.stdout:
            # Python flushes stdout once more at exit: redirect that to nowhere.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            return 0
        report(prog, f'the output cannot be written: {error.strerror}')
        return USAGE_ERROR


def _print_all(main: Callable[[], int | None]) -> int:
    """Run `main`, with any text on stdout, and flush it here, where a failure can be caught."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors='replace')
    try:
        return main() or 0
    finally:
        if sys.stdout:
            sys.stdout.flush()


def _missing(error: ImportError, prog: str) -> str | None:
    """Return the sentence for a package that cannot be imported; None if we do not require it."""
    from importlib import metadata  # noqa: PLC0415 (only for an error)

    package = (error.name or '').partition('.')[0]
    absent = isinstance(error, ModuleNotFoundError)
    if package in ROS_PACKAGES and (absent or not has_ros()):
        return str(needs_ros(prog))
    if not absent:
        return None
    name = re.compile(
        re.escape(_DISTRIBUTIONS.get(package, package).replace('_', '-')) + r'\b(?!-)'
    )
    with suppress(metadata.PackageNotFoundError):
        for requirement in metadata.requires('barc_sim') or ():
            if name.match(requirement) and 'extra ==' not in requirement:
                install = [sys.executable, '-m', 'pip', 'install', *_pip_options(), requirement]
                return (
                    f'the package {package!r} is not installed in this Python, or is too old: '
                    f'run {shlex.join(install)}'
                )
    return None


def _pip_options() -> list[str]:
    """Return what pip needs to install beside the packages of the system, as with ROS from apt."""
    managed = Path(sysconfig.get_path('stdlib'), 'EXTERNALLY-MANAGED')
    if sys.prefix == sys.base_prefix and managed.exists():
        return ['--user', '--break-system-packages']
    return []


def report(prog: str, message: str) -> None:
    """Print an error on stderr, in one line."""
    print(_error_line(prog, message), file=sys.stderr)  # noqa: T201


def _error_line(prog: str, message: str) -> str:
    return f'{prog}: error: {" ".join(message.splitlines())}'
