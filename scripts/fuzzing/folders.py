"""Working directories that a stranger has written: modules of known names, settings of libraries.

A command that is started there runs nothing of it, and gives what it gives elsewhere.
"""

from __future__ import annotations

import json
import os
import py_compile
import shutil
import subprocess
import sys
import tempfile
import time
from functools import cache
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING

from _command import Ended, judge
from _trial import ESCAPE, Trial

from barc_sim.cli.python import python_command
from barc_sim.lab.files import HILLS

if TYPE_CHECKING:
    from collections.abc import Iterator

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
_KINDS = ('file', 'package', 'folder', 'compiled', 'link', 'damaged library', 'settings', 'pipe')
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


def _run(command: str, folder: Path) -> Ended:
    """Run a command in the lab of `folder`, as the installed program does."""
    try:
        done = subprocess.run(  # noqa: S603 (our own)
            python_command('barc_sim', *command.split()),
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


def _set(kind: str, name: str, lab: Path) -> None:
    """Put a trap with the name of a module, or a settings file, into a lab."""
    trap = lab / f'{name}.py'
    match kind:
        case 'file':
            trap.write_text(_TRAP, encoding='ascii')
        case 'package':
            (lab / name).mkdir()
            (lab / name / '__init__.py').write_text(_TRAP, encoding='ascii')
        case 'folder':
            (lab / name).mkdir()
        case 'compiled':
            trap.write_text(_TRAP, encoding='ascii')
            py_compile.compile(str(trap), str(lab / f'{name}.pyc'))
            trap.unlink()
        case 'link':
            (lab.parent / 'trap.py').write_text(_TRAP, encoding='ascii')
            trap.symlink_to('../trap.py')
        case 'damaged library':
            (lab / f'{name}.so').write_bytes(b'\x7fELF')
        case 'pipe':
            os.mkfifo(lab / 'matplotlibrc')
        case _:
            chance = Random(name)  # noqa: S311 (no secret)
            setting = chance.choice([*_SETTINGS])
            (lab / setting).write_text(_SETTINGS[setting], encoding='ascii')


def trials(seed: int, numbers: range) -> Iterator[Trial]:
    """Yield what became of each command."""
    for number in numbers:
        chance = Random(f'{seed} {number}')  # noqa: S311 (no secret)
        command = chance.choices([*_COMMANDS], [often for often, _ in _COMMANDS.values()])[0]
        kind = chance.choice(_KINDS)
        names = chance.sample(_MODULES, 1 if kind == 'pipe' else chance.choice((1, 5, 60)))
        expected = _expected(command)
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder, 'place')
            shutil.copytree(_original(), place)
            for name in names:
                _set(kind, name, place / 'lab')
            yield _try(number, command, kind, expected, place)


def _try(
    number: int, command: str, kind: str, expected: tuple[int | None, object], place: Path
) -> Trial:
    began = time.monotonic()
    ended = _run(command, place)
    seconds = time.monotonic() - began
    outcome, why = judge(ended)
    caught = place / 'caught'
    if caught.exists():
        names = ' '.join(caught.read_text(encoding='ascii').split())
        outcome, why = ESCAPE, f'{names} has run'
    elif not why and (ended.code, _made(command, place)) != expected:
        outcome, why = ESCAPE, f'another result: exit code {ended.code}\n{ended.text[-2000:]}'
    return Trial(number, kind, outcome, seconds, 0.0, why and f'barc {command}: {why}')
