"""Commands that are started in a folder that somebody else has written."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from command_line import bag_of, barc
from user_files import CONTROLLER, MODEL

from barc_sim.cli.python import python_command
from barc_sim.errors import UserError
from barc_sim.lab.confined.process import Limits, check
from barc_sim.lab.files import HILLS

if TYPE_CHECKING:
    from pathlib import Path

#: What Python imports on its own, and what barc_sim and its libraries import.
NAMES = sys.stdlib_module_names | {
    *('sitecustomize', 'usercustomize', 'numpy', 'yaml', 'barc_sim', 'barc_interfaces', 'rclpy'),
    *('matplotlib', 'rich', 'jinja2', 'mcap', 'rosbags', 'system_calls', 'PIL', 'zstandard'),
}
TRAP = """\
import os
with open(os.environ['TRAP'], 'a') as file:
    file.write(f'{__name__}\\n')
raise SystemExit(__name__)
"""


def set_traps(folder: Path, *, as_folders: bool) -> None:
    """Write a module for each name, as a file or a folder, which notes that it was imported."""
    for name in NAMES:
        if as_folders:
            (folder / name).mkdir()
            (folder / name / '__init__.py').write_text(TRAP)
        else:
            (folder / f'{name}.py').write_text(TRAP)
    os.mkfifo(folder / 'matplotlibrc')  # it would be waited for without end


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run `barc COMMAND` as the installed program does: without the working directory."""
    done = subprocess.run(
        python_command('barc_sim', *words),
        cwd=folder,
        env=os.environ | {'TRAP': str(folder.parent / 'caught')},
        capture_output=True,
        text=True,
        timeout=120.0,
        check=False,
    )
    caught = folder.parent / 'caught'
    assert not caught.exists(), caught.read_text()
    return done


@pytest.fixture
def ada(tmp_path: Path) -> Path:
    """Return a folder with right code."""
    folder = tmp_path / 'ada'
    folder.mkdir()
    (folder / 'bike_model.py').write_text(MODEL)
    (folder / 'controller.py').write_text(CONTROLLER)
    return folder


@pytest.mark.parametrize('as_folders', [False, True], ids=['files', 'folders'])
def test_a_submission_is_graded_beside_modules_of_pythons_names(
    ada: Path, *, as_folders: bool
) -> None:
    try:
        check(Limits())
    except UserError as error:
        pytest.skip(str(error))
    set_traps(ada, as_folders=as_folders)
    done = run(ada, 'grade', '.', '--out', '../grades', '--jobs', '1')
    assert done.returncode == 0, done.stderr
    results = json.loads((ada.parent / 'grades' / 'results.json').read_text())
    assert results['score'] == 100.0


def test_a_lab_is_checked_and_packed_beside_modules_of_pythons_names(ada: Path) -> None:
    (ada / 'compose.py').write_bytes(HILLS.templates()['compose.py'])
    set_traps(ada, as_folders=True)
    checked = run(ada, 'check', '.')
    assert 'compose.py: is not written yet' in checked.stdout, checked.stderr
    packed = run(ada, 'submit', '.', '--save', '../ada.zip')
    (course,) = (line for line in packed.stdout.splitlines() if line.startswith('course'))
    assert 'missing' not in course


def test_settings_of_matplotlib_do_not_change_a_figure(tmp_path: Path) -> None:
    bag = bag_of(tmp_path, '--engine', 'local', '--realtime-factor', 'max', '--distance', '20')
    usual = barc('plot', str(bag), '--save', str(tmp_path / 'usual.png'))
    assert usual.returncode == 0, usual.stderr
    folder = tmp_path / 'ada'
    folder.mkdir()
    (folder / 'matplotlibrc').write_text('savefig.facecolor: red\nfont.size: 30\nbackend: none\n')
    done = run(folder, 'plot', str(bag), '--save', 'own.png')
    assert (done.returncode, done.stderr) == (0, '')
    assert (folder / 'own.png').read_bytes() == (tmp_path / 'usual.png').read_bytes()


def test_python_m_imports_nothing_more_of_the_working_directory(ada: Path) -> None:
    for name in ('argparse', 'json', 'signal', 'socket', 'numpy', 'yaml', 'rich'):
        (ada / f'{name}.py').write_text(TRAP)
    caught = ada.parent / 'caught'
    done = subprocess.run(
        [sys.executable, '-m', 'barc_sim', 'check', '.'],
        cwd=ada,
        env=os.environ | {'TRAP': str(caught)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert not caught.exists(), caught.read_text()
    assert 'criteria are met in full' in done.stdout, done.stderr
