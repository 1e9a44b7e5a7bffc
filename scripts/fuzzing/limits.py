"""Commands with odd options in an odd shell: limits, closed streams, strange environments.

The options are those that the commands declare, so that a new one is tried without a change here.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, NamedTuple

import _places
from _command import INTERRUPTED, CommandEnd, judge
from _trial import Trial

import barc_sim
from barc_sim.__main__ import functions
from barc_sim.cli.parser import Parser

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_ROOT = Path(barc_sim.__file__).parents[1]
_DRIVE = [
    *('--distance', '5', '--laps', '1', '--cars', '1', '-q'),
    *('--realtime-factor', 'max', '--min-free-space', '0'),
]


class _Command(NamedTuple):
    """A command, with words before the odd options, and after them, so that these count."""

    name: str
    before: Sequence[str]
    after: Sequence[str]


_COMMANDS = (
    _Command('acc', [], ['--engine', 'local', *_DRIVE]),
    _Command('acc', [], ['--engine', 'auto', *_DRIVE]),
    _Command('teleop', ['--engine', 'local', '--view', 'none'], []),
    _Command('teleop', ['--lab', 'lab', '--view', 'none'], []),
    _Command('plot', ['bags/run'], []),
    _Command('replay', ['bags/run', '--save', 'out/r.gif'], []),
    _Command('report', ['bags/run'], []),
    _Command('graph', ['--bag', 'bags/run'], []),
    _Command('graph', ['--save', 'out/live.svg'], []),
    _Command('recover', ['bags/killed'], []),
    _Command('new', ['new'], []),
    _Command('check', ['lab'], ['--no-plot']),
    _Command('submit', ['lab'], []),
    _Command('grade', ['class'], ['--jobs', '1']),
    _Command('tune', [], ['--distance', '20']),
    _Command('show', ['ECU'], []),
    _Command('topics', [], []),
    _Command('echo', ['ecu'], []),
    _Command('param', ['list'], []),
    _Command('param', ['get', 'controller', 'kp'], []),
    _Command('record', ['--min-free-space', '0'], []),
    _Command('node', ['relay'], []),
    _Command('node', ['bag_recorder'], []),
)
_VALUES = (
    *('', '.', '-', '--', '..', '0', '-0', '1', '-1', '1e308', '-1e309', '5e-324', '1e-9', 'nan'),
    *(
        '9' * 5000,
        'x' * 5000,
        'a/' * 2500,
        '\udcff',
        'caf\udce9.svg',
        '\u202e.png',
        'ü.csv',
        'a\nb',
    ),
    *('*', '[', '(', '%s', '{}', '\x1b[2J', 'lab', 'road.csv', '/dev/full', '/dev/null/x.png'),
    *('0x10', '٣', '1_000', 'tcp://localhost:1', 'kp=1', 'all', 'none', '/proc/self/mem', 'max'),
)
#: A damaged one, and what is none; `pipe` is a named pipe.
_PROFILES = ('', '/nonexistent.xml', 'road.csv', 'out', 'pipe', '/dev/zero')
#: None: not set.
_ENVIRONMENT: dict[str, tuple[str | None, ...]] = {
    'HOME': (None, '', '/dev/null', 'out'),
    'TMPDIR': ('/nonexistent', '', '\udcff', '/dev/null'),
    'LANG': ('C', 'tr_TR.UTF-8', 'zz_ZZ', '\udcff'),
    'LC_ALL': ('C', 'POSIX', 'ja_JP.eucJP'),
    'COLUMNS': ('0', '-5', '1', '9' * 12, 'abc'),
    'LINES': ('0', '-1', 'x'),
    'TERM': (None, '', 'dumb', 'nonsense'),
    'FORCE_COLOR': ('1',),
    'PYTHONIOENCODING': ('ascii', 'utf-16'),
    'PYTHONUTF8': ('0',),
    'TZ': ('Nowhere/Land', '\udcff', 'UTC+99'),
    'XDG_STATE_HOME': ('/nonexistent', '/dev/null', '\udcff'),
    'MPLCONFIGDIR': ('/nonexistent', '/dev/null'),
    'MPLBACKEND': ('nonsense', 'TkAgg'),
    'DISPLAY': (':99', 'nowhere:0'),
    'PATH': ('', '/nonexistent'),
    'PYTHONPATH': (f'{_ROOT}:/dev/null:/nonexistent', f'out:{_ROOT}'),
    'AMENT_PREFIX_PATH': ('/nonexistent', '\udcff'),
    'ROS_DOMAIN_ID': ('abc', '-1', '232', '233', '9999999', '9' * 5000, '1.5', '٣', ''),
    'ROS_LOG_DIR': ('/dev/null', '\udcff', '/nonexistent'),
    'ROS_LOCALHOST_ONLY': ('maybe', '1'),
    'ROS_AUTOMATIC_DISCOVERY_RANGE': ('nonsense', 'OFF'),
    'ROS_STATIC_PEERS': ('no host;;',),
    'ROS_DISCOVERY_SERVER': ('nonsense',),
    'FASTRTPS_DEFAULT_PROFILES_FILE': _PROFILES,
    'FASTDDS_DEFAULT_PROFILES_FILE': _PROFILES,
    'FASTDDS_BUILTIN_TRANSPORTS': ('nonsense',),
    'RCUTILS_COLORIZED_OUTPUT': ('x',),
    'RCUTILS_LOGGING_USE_STDOUT': ('x', '1'),
    'RCUTILS_CONSOLE_OUTPUT_FORMAT': ('{nonsense', ''),
}
_LIMITS = {
    'RLIMIT_NOFILE': (128, 256),
    'RLIMIT_FSIZE': (0, 1, 4096, 65536),
}
#: Bytes that are left on the disk of a command's folder.
_LEFT = (0, 4096, 100_000, 1_000_000)
_DURATION = 12.0  #: [s] after which a command is asked to stop, as by Ctrl-C
_TIMEOUT = 40.0  #: [s] until it has to have stopped


def original() -> None:
    """Make what all trials begin with."""
    _places.original()


def trials(seed: int, numbers: range) -> Iterator[Trial]:
    """Yield what became of each command."""
    for number in numbers:
        chance = Random(f'{seed} {number}')  # noqa: S311 (no secret)
        command = chance.choice(_COMMANDS)
        odd_words = _options(command.name, chance)
        odd = chance.choice(('options', 'limits', 'streams', 'environment', 'folder', 'all'))
        if odd not in ('options', 'all'):
            odd_words = []
        words = [command.name, *command.before, *odd_words, *command.after]
        yield _try(number, odd, words, _shell(odd, chance))


def _try(number: int, odd: str, words: list[str], shell: _Shell) -> Trial:
    with tempfile.TemporaryDirectory() as folder, _disk(Path(folder), shell.disk):
        start = time.monotonic()
        end = _run(words, Path(folder) / 'inside', shell)
    outcome, reason = judge(end)
    if reason:
        reason = f'barc {words} with {shell}: {reason}'.encode(errors='replace').decode()
    return Trial(number, odd, outcome, time.monotonic() - start, 0.0, reason)


def _options(name: str, chance: Random) -> list[str]:
    """Return one to three options of a command, with odd values, or odd words in place of them."""
    words: list[str] = []
    for _ in range(chance.randint(1, 3)):
        action = chance.choice(_actions(name))
        choices = [*(action.choices or _VALUES)]
        values = [chance.choice(choices) for _ in range(int(action.nargs or 1))]
        if chance.random() < 0.1:  # noqa: PLR2004 (now and then)
            values = [chance.choice(_VALUES)]

        words += action.option_strings[-1:]
        if action.nargs != 0:
            words += values
    return words


@cache
def _actions(name: str) -> list[argparse.Action]:
    parser = Parser(prog='fuzz')
    add_arguments, _ = functions(name)
    add_arguments(parser)

    not_options = (argparse._HelpAction, argparse._SubParsersAction)  # noqa: SLF001
    actions: list[argparse.Action] = []
    for action in parser._actions:  # noqa: SLF001 (argparse has no other list)
        if isinstance(action, not_options):
            continue
        if not isinstance(action.nargs, int):
            action.nargs = 1
        action.choices = [*action.choices] if action.choices else None
        actions.append(action)
    return actions or [argparse.Action(['--none'], 'none')]


class _Shell(NamedTuple):
    """What a command runs in."""

    limits: dict[str, int]
    closed: list[int]  #: streams
    environment: dict[str, str | None]
    disk: str | int = ''  #: bytes that are left, or 'read-only'
    removed: bool = False  #: the folder


def _shell(odd: str, chance: Random) -> _Shell:
    limits: dict[str, int] = {}
    closed: list[int] = []
    environment: dict[str, str | None] = {}
    disk: str | int = ''
    removed = False

    if odd in ('limits', 'all'):
        for name in chance.sample([*_LIMITS], chance.choice((1, 1, 2))):
            limits[name] = chance.choice(_LIMITS[name])
    if odd in ('streams', 'all'):
        closed = chance.sample((0, 1, 2), chance.randint(1, 3))
    if odd in ('environment', 'all'):
        for name in chance.sample([*_ENVIRONMENT], chance.randint(1, 4)):
            environment[name] = chance.choice(_ENVIRONMENT[name])
    if odd in ('folder', 'all'):
        removed = chance.random() < 0.2  # noqa: PLR2004 (now and then)
        disk = chance.choice(('read-only', *_LEFT))
        if os.geteuid() != 0:
            disk = ''  # root alone can mount one

    return _Shell(limits, closed, environment, disk, removed)


@contextmanager
def _disk(folder: Path, disk: str | int) -> Iterator[None]:
    """Fill `folder`, on a small disk of its own where `disk` is not ''."""
    if disk == '':
        _fill(folder)
        yield
        return

    mount = ['mount', '-t', 'tmpfs', '-o', 'size=16m', 'barc_sim_fuzz', str(folder)]
    subprocess.run(mount, check=True)  # noqa: S603 (the system's)
    try:
        _fill(folder)
        if isinstance(disk, int):
            left = shutil.disk_usage(folder).free - disk
            (folder / 'filler').write_bytes(bytes(left))
        else:
            subprocess.run(['mount', '-o', 'remount,ro', str(folder)], check=True)  # noqa: S603, S607
        yield
    finally:
        subprocess.run(['umount', '--lazy', str(folder)], check=True)  # noqa: S603, S607


def _fill(folder: Path) -> None:
    _places.copy_of_original(folder)
    os.mkfifo(folder / 'inside' / 'pipe')


def _confine(shell: _Shell) -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # ignored in the background
    if shell.removed:
        folder = tempfile.mkdtemp()
        os.chdir(folder)
        Path(folder).rmdir()

    for name, value in shell.limits.items():
        resource.setrlimit(getattr(resource, name), (value, value))
    for descriptor in shell.closed:
        os.close(descriptor)


def _run(words: list[str], folder: Path, shell: _Shell) -> CommandEnd:
    with subprocess.Popen(  # noqa: S603 (our own)
        [sys.executable, '-m', 'barc_sim', *words],
        cwd=folder,
        env=_environment(folder, shell),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        preexec_fn=lambda: _confine(shell),  # noqa: PLW1509 (one thread)
        start_new_session=True,
    ) as process:
        try:
            text, _ = process.communicate(timeout=_DURATION)
            return CommandEnd(process.returncode, text.decode(errors='replace'))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGINT)

        try:
            text, _ = process.communicate(timeout=_TIMEOUT - _DURATION)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            text, _ = process.communicate()
            return CommandEnd(None, text.decode(errors='replace'))

        code = 0 if process.returncode in INTERRUPTED else process.returncode
        return CommandEnd(code, text.decode(errors='replace'))


def _environment(folder: Path, shell: _Shell) -> dict[str, str]:
    """Return the environment variables of a command."""
    values: dict[str, str | None] = {
        **os.environ,
        'HOME': str(folder / 'home'),
        'BARC_SIM_NO_BROWSER': '1',
        'PYTHONPATH': str(_ROOT),
        **shell.environment,
    }
    return {name: value for name, value in values.items() if value is not None}
