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
from functools import cache, partial
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, NamedTuple

from _command import INTERRUPTED, Ended, judge
from _trial import Trial
from links import made, original

import barc_sim
from barc_sim.__main__ import functions
from barc_sim.cli.parser import Parser

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ['original', 'trials']
_ROOT = Path(barc_sim.__file__).parents[1]
_DRIVE = [
    *('--distance', '5', '--laps', '1', '--cars', '1', '-q'),
    *('--realtime-factor', 'max', '--min-free-space', '0'),
]
#: The commands, with words before the odd options, and after them, so that these count.
_COMMANDS: tuple[tuple[str, list[str], list[str]], ...] = (
    ('acc', [], ['--engine', 'local', *_DRIVE]),
    ('acc', [], ['--engine', 'auto', *_DRIVE]),
    ('teleop', ['--engine', 'local', '--view', 'none'], []),
    ('teleop', ['--lab', 'lab', '--view', 'none'], []),
    ('plot', ['bags/run'], []),
    ('replay', ['bags/run', '--save', 'out/r.gif'], []),
    ('report', ['bags/run'], []),
    ('graph', ['--bag', 'bags/run'], []),
    ('graph', ['--save', 'out/live.svg'], []),
    ('recover', ['bags/killed'], []),
    ('new', ['new'], []),
    ('check', ['lab'], ['--no-plot']),
    ('submit', ['lab'], []),
    ('grade', ['class'], ['--jobs', '1']),
    ('tune', [], ['--distance', '20']),
    ('show', ['ECU'], []),
    ('topics', [], []),
    ('echo', ['ecu'], []),
    ('param', ['list'], []),
    ('param', ['get', 'controller', 'kp'], []),
    ('record', ['--min-free-space', '0'], []),
    ('node', ['relay'], []),
    ('node', ['bag_recorder'], []),
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
_LIVE = 12.0  #: [s] after which a command is asked to stop, as by Ctrl-C
_PATIENCE = 40.0  #: [s] until it has to have stopped


def trials(seed: int, numbers: range) -> Iterator[Trial]:
    """Yield what became of each command."""
    for number in numbers:
        chance = Random(f'{seed} {number}')  # noqa: S311 (no secret)
        name, before, after = chance.choice(_COMMANDS)
        words = [name, *before, *_options(name, chance), *after]
        odd = chance.choice(('options', 'limits', 'streams', 'environment', 'folder', 'all'))
        if odd not in ('options', 'all'):
            words = [name, *before, *after]
        shell = _shell(odd, chance)
        with tempfile.TemporaryDirectory() as folder, _disk(Path(folder), shell.disk):
            began = time.monotonic()
            ended = _run(words, Path(folder) / 'inside', shell)
        outcome, why = judge(ended)
        why = why and f'barc {words} with {shell}: {why}'.encode(errors='replace').decode()
        yield Trial(number, odd, outcome, time.monotonic() - began, 0.0, why)


def _options(name: str, chance: Random) -> list[str]:
    """Return one to three options of a command, with odd values, or odd words in place of them."""
    words: list[str] = []
    for _ in range(chance.randint(1, 3)):
        action = chance.choice(_actions(name))
        values = [
            chance.choice([*(action.choices or _VALUES)]) for _ in range(int(action.nargs or 1))
        ]
        if chance.random() < 0.1:  # noqa: PLR2004 (now and then)
            values = [chance.choice(_VALUES)]
        words += [*action.option_strings[-1:], *(values if action.nargs != 0 else [])]
    return words


@cache
def _actions(name: str) -> list[argparse.Action]:
    parser = Parser(prog='fuzz')
    add_arguments, _ = functions(name)
    add_arguments(parser)
    found: list[argparse.Action] = []
    for action in parser._actions:  # noqa: SLF001 (argparse has no other list)
        if not isinstance(action, (argparse._HelpAction, argparse._SubParsersAction)):  # noqa: SLF001
            action.nargs = action.nargs if isinstance(action.nargs, int) else 1
            action.choices = [*action.choices] if action.choices else None
            found.append(action)
    return found or [argparse.Action(['--none'], 'none')]


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
    return _Shell(limits, closed, environment, '' if os.geteuid() else disk, removed)


@contextmanager
def _disk(folder: Path, disk: str | int) -> Iterator[None]:
    """Fill `folder`, on a small disk of its own where one is asked for; root alone can do that."""
    if disk == '':
        made(folder)
        os.mkfifo(folder / 'inside' / 'pipe')
        yield
        return
    mount = ['mount', '-t', 'tmpfs', '-o', 'size=16m', 'barc_sim_fuzz', str(folder)]
    subprocess.run(mount, check=True)  # noqa: S603 (the system's)
    try:
        made(folder)
        os.mkfifo(folder / 'inside' / 'pipe')
        if isinstance(disk, int):
            left = shutil.disk_usage(folder).free - disk
            (folder / 'filler').write_bytes(bytes(left))
        else:
            subprocess.run(['mount', '-o', 'remount,ro', str(folder)], check=True)  # noqa: S603, S607
        yield
    finally:
        subprocess.run(['umount', '--lazy', str(folder)], check=True)  # noqa: S603, S607


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


def _run(words: list[str], folder: Path, shell: _Shell) -> Ended:
    home = {'HOME': str(folder / 'home'), 'BARC_SIM_NO_BROWSER': '1', 'PYTHONPATH': str(_ROOT)}
    environment = os.environ | home | shell.environment
    with subprocess.Popen(  # noqa: S603 (our own)
        [sys.executable, '-m', 'barc_sim', *words],
        cwd=folder,
        env={name: value for name, value in environment.items() if value is not None},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        preexec_fn=partial(_confine, shell),  # noqa: PLW1509 (one thread)
        start_new_session=True,
    ) as process:
        try:
            text, _ = process.communicate(timeout=_LIVE)
            return Ended(process.returncode, text.decode(errors='replace'))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGINT)
        try:
            text, _ = process.communicate(timeout=_PATIENCE - _LIVE)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return Ended(None, process.communicate()[0].decode(errors='replace'))
        code = 0 if process.returncode in INTERRUPTED else process.returncode
        return Ended(code, text.decode(errors='replace'))
