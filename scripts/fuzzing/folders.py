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
from functools import cache
from importlib.machinery import BuiltinImporter, FrozenImporter
from itertools import groupby
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, NamedTuple

from _command import Ended, judge
from _trial import ESCAPE, RESULT, SENTENCE, Trial

from barc_sim.cli.python import python_command
from barc_sim.lab.files import HILLS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_PATIENCE = 120.0  #: [s] for a command on a busy machine
_RUN = 'acc -q --engine local --distance 8 --road flat --realtime-factor max'
#: By command, which works in a lab: how often it is drawn, and the file that it makes.
_COMMANDS = {
    'grade . --out ../out --jobs 1': (4, 'results.json'),
    'check .': (2, ''),
    'submit . --save ../out/lab.zip': (2, ''),
    'plot ../bag --save ../out/plot.png': (2, 'plot.png'),
    'report ../bag -o ../out/report.html': (1, ''),
    'info ../bag': (2, ''),
    'convert ../bag -o ../out/tables': (1, ''),
    f'{_RUN} --lab . --bag-dir ../out/bags': (2, ''),
    'new ../out/new': (1, ''),
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
_TOGETHER = 20  #: trials of one run
_OTHERS = 60  #: names beside them
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
_CODE = {
    'bike_model.py': 'def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):\n'
    '    return [x + ts * v, y, psi, v + ts * a]\n',
    'controller.py': 'class PID:\n    def __init__(self, kp=30.0, ki=0.0, kd=0.0):\n'
    '        self.kp, self.ki, self.kd = kp, ki, kd\n\n'
    '    def acc_calculate(self, speed_reference, speed_current, dt):\n'
    '        return self.kp * (speed_reference - speed_current)\n',
    'compose.py': HILLS.templates()['compose.py'].decode(),
}


def original() -> None:
    """Make what all trials begin with."""
    _original()


@cache
def _original() -> Path:
    """Return a folder with a lab and a bag."""
    folder = Path(tempfile.mkdtemp(prefix='fuzz_folders_'))
    (folder / 'lab').mkdir()
    (folder / 'out').mkdir()
    for name, text in _CODE.items():
        (folder / 'lab' / name).write_text(text, encoding='ascii')
    ended = _run(f'{_RUN} --bag-dir ../made', folder)
    if ended.code:
        raise RuntimeError(ended.text)
    (made,) = (folder / 'made').iterdir()
    made.replace(folder / 'bag')
    return folder


def _run(command: str, folder: Path, python: str = sys.executable) -> Ended:
    """Run a command in the lab of `folder`, as the installed program does."""
    _, *words = python_command('barc_sim', *command.split())
    try:
        done = subprocess.run(  # noqa: S603 (our own)
            [python, *words],
            cwd=folder / 'lab',
            env=os.environ | {'TRAP': str(folder / 'caught'), 'BARC_SIM_NO_BROWSER': '1'},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=_PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Ended(None, '')
    return Ended(done.returncode, (done.stdout + done.stderr).decode(errors='replace'))


def _made(command: str, folder: Path) -> object:
    """Return what a command has made, as far as it is the same each time."""
    _, name = _COMMANDS[command]
    if not name:
        return None
    path = folder / 'out' / name
    if not path.exists():
        return 'nothing'
    return json.loads(path.read_bytes())['score'] if path.suffix == '.json' else path.read_bytes()


@cache
def _expected(command: str) -> tuple[int | None, object]:
    """Return the exit code of a command in a lab without traps, and what it makes."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder, 'place')
        shutil.copytree(_original(), place)
        return _run(command, place).code, _made(command, place)


@cache
def _imported(command: str) -> list[str]:
    """Return the modules that a command, and the processes that it starts, import from files."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder, 'place')
        shutil.copytree(_original(), place)
        imports = place / 'imports'
        _run(command, place, _python_with_list(place / 'venv', imports))
        names = {*imports.read_text(encoding='utf-8').split()}
    inside = BuiltinImporter, FrozenImporter  # their modules come from no file
    return sorted(name for name in names if not any(each.find_spec(name) for each in inside))


def _python_with_list(folder: Path, file: Path) -> str:
    """Make a Python that lists the modules that its processes import; return its program."""
    venv.create(folder, symlinks=True)
    packages = Path(sysconfig.get_path('purelib', 'posix_prefix', {'base': str(folder)}))
    (packages / 'listing.pth').write_text('import listing\n', encoding='ascii')
    (packages / 'listing.py').write_text(_LISTING.format(file=str(file)), encoding='utf-8')
    return str(folder / 'bin' / 'python')


class _Trap(NamedTuple):
    """What is in the working directory in place of a module."""

    number: int  #: of the trial
    kind: str
    name: str  #: of the module

    def put(self, lab: Path) -> None:
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


class _Surroundings(NamedTuple):
    """What else is in the working directory: it belongs to no single trial."""

    others: Sequence[_Trap] = ()
    settings: Sequence[tuple[str, bool]] = ()  #: names of files, and whether each is a pipe

    @classmethod
    def drawn(cls, chance: Random, names: Sequence[str]) -> _Surroundings:
        """Draw some beside traps of these names."""
        more = chance.sample(sorted({*_MODULES} - {*names}), _OTHERS)
        others = [_Trap(-1, chance.choice((*_KINDS, _FOLDER)), name) for name in more]
        settings = chance.sample([*_SETTINGS], chance.randint(0, len(_SETTINGS)))
        return cls(others, [(name, chance.random() < _PIPES) for name in settings])

    def put(self, lab: Path) -> None:
        """Write them into a lab."""
        for other in self.others:
            other.put(lab)
        for name, is_pipe in self.settings:
            if is_pipe:
                os.mkfifo(lab / name)
            else:
                (lab / name).write_text(_SETTINGS[name], encoding='ascii')


def trials(seed: int, numbers: range) -> Iterator[Trial]:
    """Yield what became of each name."""
    for run, together in groupby(numbers, lambda number: number // _TOGETHER):
        chance = Random(f'{seed} {run}')  # noqa: S311 (no secret)
        command = chance.choices([*_COMMANDS], [often for often, _ in _COMMANDS.values()])[0]
        names = chance.sample(_imported(command), _TOGETHER)
        traps = [
            _Trap(run * _TOGETHER + k, chance.choice(_KINDS), name) for k, name in enumerate(names)
        ]
        surroundings = _Surroundings.drawn(chance, names)
        wanted = [*together]
        yield from _tried(command, [each for each in traps if each.number in wanted], surroundings)


def _tried(command: str, traps: Sequence[_Trap], surroundings: _Surroundings) -> list[Trial]:
    """Try traps in one run; each alone if it fails, so that the trial that fails is named."""
    trial = _try(command, traps, surroundings)
    is_failure = trial.outcome not in (RESULT, SENTENCE)
    found = [trial._replace(number=each.number, damaged=each.kind) for each in traps]
    if not is_failure or len(traps) == 1:
        return found
    alone = [_tried(command, [each], _Surroundings())[0] for each in traps]
    if any(each.outcome not in (RESULT, SENTENCE) for each in alone):
        return alone
    return [found[0], *alone[1:]]  # by what is beside the traps


def _try(command: str, traps: Sequence[_Trap], surroundings: _Surroundings) -> Trial:
    """Run a command in a lab with traps; return what became of it."""
    exit_code, made = _expected(command)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder, 'place')
        shutil.copytree(_original(), place)
        for trap in traps:
            trap.put(place / 'lab')
        surroundings.put(place / 'lab')

        began = time.monotonic()
        ended = _run(command, place)
        seconds = time.monotonic() - began

        outcome, why = judge(ended)
        caught = place / 'caught'
        if caught.exists():
            names = ' '.join(caught.read_text(encoding='ascii').split())
            outcome = ESCAPE
            why = f'{names} has run'
        elif not why and (ended.code, _made(command, place)) != (exit_code, made):
            outcome = ESCAPE
            why = f'another result: exit code {ended.code}\n{ended.text[-2000:]}'
    return Trial(-1, '', outcome, seconds, 0.0, why and f'barc {command}: {why}')
