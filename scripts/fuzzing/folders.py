"""Working directories that a stranger has written: modules of known names, settings of libraries.

A command that is started there runs nothing of it, and gives what it gives elsewhere.

A trial is the name of one module in the working directory of one command. It is a name that this
command, or a process that it starts, imports from a file: another one would prove nothing. Some
trials share a run, because a command needs seconds. Where a run fails, each of its trials is
repeated alone.
"""

from __future__ import annotations

import json
import os
import py_compile
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
import venv
from contextlib import contextmanager
from functools import cache
from importlib.machinery import BuiltinImporter, FrozenImporter
from itertools import groupby
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, NamedTuple

from _command import CommandEnd, judge
from _trial import ESCAPE, Trial

from barc_sim.cli.python import python_command
from barc_sim.lab.files import HILLS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_TIMEOUT = 120.0  #: [s] for a command on a busy machine
_RUN = 'acc -q --engine local --distance 8 --road flat --realtime-factor max'


class _Command(NamedTuple):
    """How often a command is drawn, and the file that it makes, or ''."""

    weight: int
    product: str


#: By its words. Each one works in a lab.
_COMMANDS = {
    'grade . --out ../out --jobs 1': _Command(4, 'results.json'),
    'check .': _Command(2, ''),
    'submit . --save ../out/lab.zip': _Command(2, ''),
    'plot ../bag --save ../out/plot.png': _Command(2, 'plot.png'),
    'report ../bag -o ../out/report.html': _Command(1, ''),
    'info ../bag': _Command(2, ''),
    'convert ../bag -o ../out/tables': _Command(1, ''),
    f'{_RUN} --lab . --bag-dir ../out/bags': _Command(2, ''),
    'new ../out/new': _Command(1, ''),
}
#: Names that are put beside those that are tried.
_MODULES = sorted(
    sys.stdlib_module_names
    | {'sitecustomize', 'usercustomize', 'numpy', 'yaml', 'barc_sim', 'barc_interfaces', 'rclpy'}
    | {'matplotlib', 'rich', 'jinja2', 'mcap', 'rosbags', 'system_calls', 'PIL', 'zstandard', 'lz4'}
    | {'scipy', 'numba', 'daqp', 'argcomplete', 'websockets', 'pygments', 'child', 'process'}
)
#: What libraries and tools read from a working directory.
_SETTINGS = {
    'matplotlibrc': 'savefig.facecolor: red\nfont.size: 30\nbackend: none\n',
    '.matplotlibrc': 'font.size: 30\n',
    'DEFAULT_FASTRTPS_PROFILES.xml': '<dds><nothing/>',
    'DEFAULT_FASTDDS_PROFILES.xml': '<dds><nothing/>',
    '.numba_config.yaml': 'disable_jit: 1\n',
    'pyvenv.cfg': 'home = /nowhere\n',
    'python311._pth': '.\n',
    'own.pth': 'import trap\n',
    'pip.conf': '[global]\nindex-url = http://127.0.0.1:9\n',
    'setup.cfg': '[tool:pytest]\naddopts = -p trap\n',
    'pytest.ini': '[pytest]\naddopts = -p trap\n',
    'conftest.py': 'import trap\n',
    'barc_sim.toml': 'seed = 7\n',
    '.env': 'PYTHONPATH=.\n',
}
_TRAP = """\
import os
with open(os.environ['TRAP'], 'a') as file:
    file.write(f'{__name__}\\n')
raise SystemExit(__name__)
"""
_KINDS = ('file', 'package', 'compiled', 'link', 'damaged library')
_FOLDER = 'folder'  #: without a file: it takes the place of no module
_TRIALS_PER_RUN = 20
_NEIGHBOURS = 60  #: names beside those of the trials
_PIPES = 0.2  #: share of the settings that are named pipes
#: Appends the name of each imported module to a file, also where the process is confined later.
_LISTING = """\
import os
import sys

_LIST = os.open({file!r}, os.O_WRONLY | os.O_APPEND | os.O_CREAT)


def listed(event, values):
    if event == 'import' and '.' not in values[0]:
        try:
            os.write(_LIST, f'{{values[0]}}\\n'.encode())
        except OSError:
            pass


sys.addaudithook(listed)
"""
#: A student's.
_SUBMISSION = Path(__file__).parents[1] / 'submission'


def original() -> None:
    """Make what all trials begin with."""
    _original()


@cache
def _original() -> Path:
    """Return a folder with a lab and a bag."""
    folder = Path(tempfile.mkdtemp(prefix='fuzz_folders_'))
    (folder / 'out').mkdir()
    shutil.copytree(_SUBMISSION, folder / 'lab')
    (folder / 'lab' / 'compose.py').write_bytes(HILLS.templates()['compose.py'])

    end = _run(f'{_RUN} --bag-dir ../bags', folder)
    if end.code:
        raise RuntimeError(end.text)
    (bag,) = (folder / 'bags').iterdir()
    bag.replace(folder / 'bag')
    (folder / 'bags').rmdir()
    return folder


@contextmanager
def _copy() -> Iterator[Path]:
    """Yield a copy of what all trials begin with."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder, 'place')
        shutil.copytree(_original(), place)
        yield place


def _run(command: str, folder: Path, python: str = sys.executable) -> CommandEnd:
    """Run a command in the lab of `folder`, as the installed program does."""
    words = python_command('barc_sim', *command.split())[1:]
    try:
        process = subprocess.run(  # noqa: S603 (our own)
            [python, *words],
            cwd=folder / 'lab',
            env=os.environ | {'TRAP': str(folder / 'trapped'), 'BARC_SIM_NO_BROWSER': '1'},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=_TIMEOUT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return CommandEnd(None, '')
    output = process.stdout + process.stderr
    return CommandEnd(process.returncode, output.decode(errors='replace'))


def _product(command: str, folder: Path) -> object:
    """Return what a command has made, as far as it is the same each time."""
    name = _COMMANDS[command].product
    if not name:
        return None
    path = folder / 'out' / name
    if not path.exists():
        return 'nothing'
    if path.suffix == '.json':
        return json.loads(path.read_bytes())['score']
    return path.read_bytes()


@cache
def _expected(command: str) -> tuple[int | None, object]:
    """Return the exit code of a command in a lab without traps, and what it makes."""
    with _copy() as place:
        end = _run(command, place)
        return end.code, _product(command, place)


@cache
def imported_modules(command: str) -> list[str]:
    """Return the modules that a command, and the processes that it starts, import from files."""
    with _copy() as place:
        imports = place / 'imports'
        _run(command, place, _python_with_list(place / 'venv', imports))
        names = set(imports.read_text(encoding='utf-8').split())
    return sorted(name for name in names if not _is_inside_python(name))


def _is_inside_python(name: str) -> bool:
    """Return whether a module comes from no file."""
    return any(finder.find_spec(name) for finder in (BuiltinImporter, FrozenImporter))


def _python_with_list(folder: Path, file: Path) -> str:
    """Make a Python that lists the modules that its processes import; return its program."""
    venv.create(folder, symlinks=True)
    packages = Path(sysconfig.get_path('purelib', 'posix_prefix', {'base': str(folder)}))
    (packages / 'listing.pth').write_text('import listing\n', encoding='ascii')
    (packages / 'listing.py').write_text(_LISTING.format(file=str(file)), encoding='utf-8')
    return str(folder / 'bin' / 'python')


class Trap(NamedTuple):
    """What is in the working directory in place of a module."""

    number: int  #: of the trial
    kind: str
    name: str  #: of the module

    def write(self, lab: Path) -> None:
        """Write it into a lab."""
        path = lab / f'{self.name}.py'
        package = lab / self.name
        match self.kind:
            case 'file':
                path.write_text(_TRAP, encoding='ascii')
            case 'package':
                package.mkdir()
                (package / '__init__.py').write_text(_TRAP, encoding='ascii')
            case 'compiled':
                path.write_text(_TRAP, encoding='ascii')
                py_compile.compile(str(path), f'{path}c')
                path.unlink()
            case 'link':
                (lab.parent / 'trap.py').write_text(_TRAP, encoding='ascii')
                path.symlink_to('../trap.py')
            case 'damaged library':
                path.with_suffix('.so').write_bytes(b'\x7fELF')
            case _:
                package.mkdir()


class Surroundings(NamedTuple):
    """What else is in the working directory: it belongs to no single trial."""

    traps: Sequence[Trap] = ()
    settings: Sequence[str] = ()  #: names of files
    pipes: Sequence[str] = ()  #: names of settings that are named pipes

    @classmethod
    def draw(cls, chance: Random, names: Sequence[str]) -> Surroundings:
        """Draw some beside traps of these names."""
        free_names = sorted(set(_MODULES) - set(names))
        neighbours = chance.sample(free_names, _NEIGHBOURS)
        traps = [Trap(-1, chance.choice((*_KINDS, _FOLDER)), name) for name in neighbours]

        settings = []
        pipes = []
        for name in chance.sample([*_SETTINGS], chance.randint(0, len(_SETTINGS))):
            if chance.random() < _PIPES:
                pipes.append(name)
            else:
                settings.append(name)
        return cls(traps, settings, pipes)

    def write(self, lab: Path) -> None:
        """Write them into a lab."""
        for trap in self.traps:
            trap.write(lab)
        for name in self.settings:
            (lab / name).write_text(_SETTINGS[name], encoding='ascii')
        for name in self.pipes:
            os.mkfifo(lab / name)


def trials(seed: int, numbers: range) -> Iterator[Trial]:
    """Yield what became of each name."""
    weights = [command.weight for command in _COMMANDS.values()]
    for run, numbers_of_run in groupby(numbers, lambda number: number // _TRIALS_PER_RUN):
        chance = Random(f'{seed} {run}')  # noqa: S311 (no secret)
        command = chance.choices([*_COMMANDS], weights)[0]
        names = chance.sample(imported_modules(command), _TRIALS_PER_RUN)

        # The same traps are drawn, whichever of the trials are asked for.
        first = run * _TRIALS_PER_RUN
        traps = [
            Trap(number, chance.choice(_KINDS), name) for number, name in enumerate(names, first)
        ]
        surroundings = Surroundings.draw(chance, names)
        wanted_numbers = set(numbers_of_run)
        wanted_traps = [trap for trap in traps if trap.number in wanted_numbers]
        yield from try_traps(command, wanted_traps, surroundings)


def try_traps(command: str, traps: Sequence[Trap], surroundings: Surroundings) -> list[Trial]:
    """Try traps in one run; each alone if it fails, so that the trial that fails is named."""
    trial = _try_together(command, traps, surroundings)
    together = [trial._replace(number=trap.number, damage=trap.kind) for trap in traps]
    if not trial.is_failure or len(traps) == 1:
        return together

    alone = [try_traps(command, [trap], Surroundings())[0] for trap in traps]
    if any(trial.is_failure for trial in alone):
        return alone
    return [together[0], *alone[1:]]  # the surroundings make it fail


def _try_together(command: str, traps: Sequence[Trap], surroundings: Surroundings) -> Trial:
    """Run a command in a lab with traps; return what became of it."""
    expected = _expected(command)
    with _copy() as place:
        for trap in traps:
            trap.write(place / 'lab')
        surroundings.write(place / 'lab')

        start = time.monotonic()
        end = _run(command, place)
        seconds = time.monotonic() - start

        outcome, reason = judge(end)
        trapped = place / 'trapped'
        if trapped.exists():
            names = ' '.join(trapped.read_text(encoding='ascii').split())
            outcome = ESCAPE
            reason = f'{names} has run'
        elif not reason and (end.code, _product(command, place)) != expected:
            outcome = ESCAPE
            reason = f'another result: exit code {end.code}\n{end.text[-2000:]}'
    return Trial(-1, '', outcome, seconds, 0.0, reason and f'barc {command}: {reason}')
