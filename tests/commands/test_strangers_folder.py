"""Commands that are started in a folder that somebody else has written."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from typing import TYPE_CHECKING

import pytest
from command_line import bag_of, barc
from user_files import CONTROLLER, MODEL

from barc_sim.cli.process import has_ros
from barc_sim.cli.python import python_command
from barc_sim.errors import UserError
from barc_sim.lab.confined.process import ProcessLimits, check_confinement
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
    process = subprocess.run(
        python_command('barc_sim', *words),
        cwd=folder,
        env=os.environ | {'TRAP': str(folder.parent / 'caught')},
        capture_output=True,
        text=True,
        timeout=1200.0,
        check=False,
    )
    caught = folder.parent / 'caught'
    assert not caught.exists(), caught.read_text()
    return process


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
        check_confinement(ProcessLimits())
    except UserError as error:
        pytest.skip(str(error))
    set_traps(ada, as_folders=as_folders)
    process = run(ada, 'grade', '.', '--out', '../grades', '--jobs', '1')
    assert process.returncode == 0, process.stderr

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
    process = run(folder, 'plot', str(bag), '--save', 'own.png')
    assert (process.returncode, process.stderr) == (0, '')
    assert (folder / 'own.png').read_bytes() == (tmp_path / 'usual.png').read_bytes()


@pytest.mark.skipif(not has_ros(), reason='without ROS')
@pytest.mark.usefixtures('ros_domain')
def test_settings_of_fast_dds_are_not_read(tmp_path: Path) -> None:
    folder = tmp_path / 'ada'
    folder.mkdir()
    log = tmp_path / 'written'
    (folder / 'DEFAULT_FASTRTPS_PROFILES.xml').write_text(
        '<dds><log><use_default>FALSE</use_default><consumer><class>FileConsumer</class><property>'
        f'<name>filename</name><value>{log}</value></property></consumer></log><wrong/></dds>'
    )
    process = run(folder, 'topics')

    assert 'no node is running' in process.stderr
    assert not log.exists()


def test_python_m_imports_nothing_more_of_the_working_directory(ada: Path) -> None:
    for name in ('argparse', 'json', 'signal', 'socket', 'numpy', 'yaml', 'rich'):
        (ada / f'{name}.py').write_text(TRAP)
    caught = ada.parent / 'caught'
    process = subprocess.run(
        [sys.executable, '-m', 'barc_sim', 'check', '.'],
        cwd=ada,
        env=os.environ | {'TRAP': str(caught)},
        capture_output=True,
        text=True,
        check=False,
    )

    assert not caught.exists(), caught.read_text()
    assert 'criteria are met in full' in process.stdout, process.stderr


#: Honest submissions, right and wrong ones.
HONEST = {
    **{f'right_{k}': {'bike_model': MODEL, 'controller': CONTROLLER} for k in range(6)},
    **{f'model_{k}': {'bike_model': MODEL} for k in range(5)},
    **{f'controller_{k}': {'controller': CONTROLLER} for k in range(4)},
    'wrong_sign': {'bike_model': MODEL.replace('ts * (a', 'ts * (-a')},
    'syntax_error': {'bike_model': 'def bikeFE(:', 'controller': CONTROLLER},
    'template': {'bike_model': 'def bikeFE(x, y):\n    raise NotImplementedError'},
    'half': {'controller': CONTROLLER.replace('self.ki', '0.5 * self.ki')},
    'prints': {'controller': CONTROLLER.replace('error =', 'print(dt); error =')},
}
_FORGED = """
import sys
code = sys.modules['barc_sim.lab.user_code.code'].UserCode
code.{} = lambda *_: {}
"""
#: What strangers hand in, by the name of its folder.
STRANGE: dict[bytes, dict[str, str]] = {
    b'socket': {'__init__': TRAP, 'bike_model': MODEL},
    b'json': {'__init__': TRAP},
    b'signal': {'__init__': TRAP},
    b'modules': {**dict.fromkeys(sorted(NAMES)[:100], TRAP), 'bike_model': MODEL},
    b'class.csv': {'bike_model': MODEL},
    b'class.csv.submission': {'controller': CONTROLLER},
    b'ren\xe9': {'bike_model': MODEL},
    rb'ren\udce9': {'controller': CONTROLLER},
    b'\xff' * 250: {'bike_model': MODEL},
    b'lines': {'bike_model': _FORGED.format('lines', "[['a', 1.0]] * 2_000_000") + 'bikeFE = min'},
    b'beyond': {'bike_model': _FORGED.format('functions', '[[10**400] * 4] * 10') + MODEL},
    b'nested': {'bike_model': _FORGED.format('functions', "eval('[' * 90 + ']' * 90)") + MODEL},
    b'notes': {'controller': _FORGED.format('notes', "{'gains': [10**400] * 4}") + CONTROLLER},
    b'half_a_pair': {'bike_model': "raise ValueError('\\ud800')"},
    b'pair_printed': {'bike_model': "print(repr('\\ud800'))\n" + MODEL},
    b'loop': {'bike_model': 'while True: pass'},
}


@pytest.mark.slow
@pytest.mark.timeout(1800)  # 60 gradings
def test_twenty_submissions_get_the_same_points_in_a_class_of_forty_as_alone(
    tmp_path: Path,
) -> None:
    try:
        check_confinement(ProcessLimits())
    except UserError as error:
        pytest.skip(str(error))
    folder = tmp_path / 'class'
    everybody = {os.fsencode(name): files for name, files in HONEST.items()} | STRANGE
    for name, files in everybody.items():
        (folder / os.fsdecode(name)).mkdir(parents=True)
        for stem, text in files.items():
            (folder / os.fsdecode(name) / f'{stem}.py').write_text(text)
    os.mkfifo(folder / 'matplotlibrc')
    (folder / 'sitecustomize.py').write_text(TRAP)
    (folder / 'DEFAULT_FASTRTPS_PROFILES.xml').write_text('<dds><nothing/>')
    secret = tmp_path / 'secret'
    secret.mkdir()
    (secret / 'bike_model.py').write_text('the_secret = 1\n' + MODEL)
    exchanged = folder / 'exchanged'
    (exchanged / 'lab').mkdir(parents=True)
    (exchanged / 'lab' / 'bike_model.py').write_text(MODEL)
    assert len([*folder.iterdir()]) == 2 * len(HONEST) == 40

    over = threading.Event()

    def exchange() -> None:
        real = exchanged / 'real'
        while not over.is_set():
            (exchanged / 'lab').rename(real)
            (exchanged / 'lab').symlink_to(secret)
            (exchanged / 'lab').unlink()
            real.rename(exchanged / 'lab')

    thread = threading.Thread(target=exchange)
    thread.start()
    try:
        process = run(
            folder, 'grade', '.', '--out', '../grades', '--jobs', '2', '--time-limit', '30'
        )
    finally:
        over.set()
        thread.join()

    assert (process.returncode, process.stderr) == (0, '')
    out = tmp_path / 'grades'
    assert len([path for path in out.iterdir() if (path / 'report.html').exists()]) == 40
    assert 'the_secret' not in (out / 'exchanged' / 'report.html').read_text()
    for name in HONEST:
        alone = tmp_path / 'alone' / name
        assert barc('grade', str(folder / name), '--out', str(alone)).returncode == 0
        for file in ('results.json', 'report.html'):
            assert (alone / file).read_bytes() == (out / name / file).read_bytes()
