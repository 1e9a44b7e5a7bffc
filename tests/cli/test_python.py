"""Where helper processes start, and what of the working directory decides nothing."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

import barc_sim
from barc_sim.cli.python import ignore_working_directory, python_command, working_in

PACKAGES = str(Path(barc_sim.__file__).parents[1])


@pytest.fixture
def trap(tmp_path: Path) -> Path:
    """Return a folder with a module for each name of the standard library; each fails."""
    folder = tmp_path / 'stranger'
    folder.mkdir()
    for name in sys.stdlib_module_names | {'sitecustomize', 'numpy', 'barc_sim'}:
        (folder / f'{name}.py').write_text('raise SystemExit("a stranger\'s code has run")')
    return folder


def test_a_helper_runs_no_file_of_a_strangers_folder(trap: Path) -> None:
    process = subprocess.run(
        python_command('barc_sim', '--version'),
        cwd=trap,
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.stdout == f'barc {barc_sim.__version__}\n', process.stderr


def test_the_script_run_imports_no_file_of_a_strangers_folder(trap: Path) -> None:
    script = Path(__file__).parents[2] / 'scripts' / 'run'
    match = re.search('^start="(.*?)"$', script.read_text(), re.DOTALL | re.MULTILINE)
    assert match
    assert '"$python" $safe_path -c "$start"' in script.read_text()
    safe_path = ['-P'] if sys.version_info >= (3, 11) else []
    command = [sys.executable, *safe_path, '-c', match[1], '--version']
    process = subprocess.run(command, cwd=trap, capture_output=True, text=True, check=False)
    assert process.stdout == f'barc {barc_sim.__version__}\n', process.stderr


def test_a_helper_gets_its_words_unchanged(tmp_path: Path) -> None:
    (tmp_path / 'shown.py').write_text('import sys; print(__name__, sys.argv[1:])')
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(tmp_path)
        command = python_command('shown', 'a b', '', '--x=:')
    process = subprocess.run(command, capture_output=True, text=True, check=True)
    assert process.stdout == "__main__ ['a b', '', '--x=:']\n"


def test_the_path_loses_the_working_directory_but_not_that_of_barc_sim(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = tmp_path / 'link'
    link.symlink_to(tmp_path)
    monkeypatch.setattr(sys, 'path', ['', str(tmp_path), str(link), PACKAGES])

    with working_in(tmp_path):
        ignore_working_directory()
        assert sys.path == [PACKAGES]

    for folder in (PACKAGES, sysconfig.get_path('purelib')):
        sys.path[:] = [PACKAGES, sysconfig.get_path('purelib')]
        with working_in(Path(folder)):
            ignore_working_directory()
        assert sys.path == [PACKAGES, sysconfig.get_path('purelib')]


def test_a_deleted_working_directory_does_not_stop_a_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, 'path', ['', PACKAGES])
    deleted = tmp_path / 'gone'
    deleted.mkdir()

    with working_in(deleted):
        deleted.rmdir()
        ignore_working_directory()
        with working_in(tmp_path):
            assert Path.cwd() == tmp_path
        assert not Path().exists() or not [*os.scandir()]


def test_no_other_module_starts_python_by_the_name_of_a_module() -> None:
    for path in Path(PACKAGES, 'barc_sim').rglob('*.py'):
        assert "sys.executable, '-m'" not in path.read_text(encoding='utf-8'), path


def test_python_m_starts_in_a_deleted_directory(tmp_path: Path) -> None:
    deleted = tmp_path / 'gone'
    deleted.mkdir()
    with working_in(deleted):
        deleted.rmdir()
        command = [sys.executable, '-m', 'barc_sim', '--version']
        process = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (process.stdout, process.stderr) == (f'barc {barc_sim.__version__}\n', '')
