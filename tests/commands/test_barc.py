"""`barc`: its commands, its help, its completion, and what is installed for it."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import pytest
from command_line import barc

import barc_sim
from barc_sim.__main__ import functions
from barc_sim.commands import COMMANDS, GROUPS
from barc_sim.interfaces.nodes import ALONE

PACKAGE = Path(barc_sim.__file__).parent
SCRIPT = Path(sys.prefix) / 'bin' / 'barc'
EXECUTABLES = Path(sys.prefix) / 'lib' / 'barc_sim'
installed = pytest.mark.skipif(
    not (SCRIPT.exists() and EXECUTABLES.exists()), reason='barc_sim is not installed with pip here'
)


# Commands


@pytest.mark.parametrize('argv', [[], ['--help']])
def test_every_command_is_listed_in_its_group(argv: list[str]) -> None:
    process = barc(*argv)
    assert process.returncode == 0
    lines = process.stdout.splitlines()
    for group, commands in GROUPS.items():
        first = lines.index(f'{group}:') + 1
        listed = [line.split()[0] for line in lines[first : first + len(commands)]]
        assert listed == list(commands)


@pytest.mark.parametrize('name', ['acc', 'teleop'])
def test_help_of_a_run_fits_on_one_screen_and_all_is_in_help_all(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('COLUMNS', '80')
    text = barc(name, '--help').stdout
    assert len(text.splitlines()) <= 24
    assert '--mirrors' not in text
    everything = barc(name, '--help-all').stdout
    assert {'--mirrors', '--min-free-space', '--ros-args'} <= {*everything.split()}


def test_every_command_has_a_module_and_every_module_a_command() -> None:
    modules = {path.stem for path in (PACKAGE / 'commands').glob('*.py')} - {'__init__'}
    modules_of_commands = {Path(functions(name)[1].__code__.co_filename).stem for name in COMMANDS}
    assert modules == modules_of_commands


@pytest.mark.parametrize(
    ('argv', 'sentence'),
    [
        (['plto'], "barc: error: there is no command 'plto': did you mean plot? (see --help)\n"),
        (['zzz'], "barc: error: there is no command 'zzz' (see --help)\n"),
        (['plot', '--save'], 'barc plot: error: argument --save: expected one argument'),
        (['echo', 'ecu', '-n', '0'], 'barc echo: error: argument -n: 0 is not a whole number of'),
        (['plot', '--ros-args'], "barc plot: error: there is no option '--ros-args'"),
        (['node', 'controller', '--kp', '3'], "barc node: error: a node takes no '--kp': give"),
        (['node', 'pilot'], "barc node: error: argument NAME: invalid choice: 'pilot'"),
    ],
)
def test_a_mistake_is_one_sentence_and_exit_code_2(argv: list[str], sentence: str) -> None:
    process = barc(*argv)
    assert (process.returncode, process.stdout) == (2, '')
    assert process.stderr.startswith(sentence)
    assert process.stderr.count('\n') == 1


def test_version_is_the_packages() -> None:
    assert barc('--version').stdout == f'barc {barc_sim.__version__}\n'


def test_help_of_every_command_waits_for_no_library() -> None:
    program = (
        'import sys\n'
        f'for name in {[*COMMANDS]}:\n'
        '    from barc_sim.__main__ import main\n'
        '    try: main([name, "--help"])\n'
        '    except SystemExit as end: assert end.code == 0\n'
        'slow = {"numpy", "rclpy", "matplotlib", "rich", "argcomplete"} & {*sys.modules}\n'
        'assert not slow, slow\n'
    )
    process = subprocess.run(
        [sys.executable, '-c', program],
        cwd=PACKAGE.parent,
        capture_output=True,
        text=True,
        check=False,
        timeout=200,
    )

    assert (process.returncode, process.stderr) == (0, '')
    for name in COMMANDS:
        assert f'usage: barc {name} ' in process.stdout


# Completion


@pytest.mark.parametrize(
    ('line', 'completed'),
    [('barc plo', 'plot'), ('barc replay --sa', '--save'), ('barc node keyb', 'keyboard')],
)
def test_commands_and_options_are_completed(line: str, completed: str, tmp_path: Path) -> None:
    assert 'complete ' in barc('--completion', 'bash').stdout

    variables = {
        '_ARGCOMPLETE': '1',
        '_ARGCOMPLETE_STDOUT_FILENAME': str(tmp_path / 'found'),
        'COMP_LINE': line,
        'COMP_POINT': str(len(line)),
    }
    command = [sys.executable, '-m', 'barc_sim']
    subprocess.run(command, cwd=PACKAGE.parent, env=os.environ | variables, check=True, timeout=200)
    assert (tmp_path / 'found').read_text().split() == [completed]


# What is installed


def test_barc_is_the_only_program_so_that_none_of_the_system_is_hidden() -> None:
    programs = {
        script.name
        for script in entry_points(group='console_scripts')
        if script.value.startswith('barc_sim')
    }
    assert programs in ({'barc'}, set())  # none where colcon has built the package


@installed
def test_ros2_run_finds_every_command_and_node() -> None:
    names = {path.name for path in EXECUTABLES.iterdir() if os.access(path, os.X_OK)}
    assert names == {*COMMANDS, *ALONE} - {'node'}


@installed
@pytest.mark.parametrize(
    ('words', 'code', 'out'),
    [
        (['plot', '--help'], 0, 'usage: barc plot '),
        (['relay', '--ros-args', '-p'], 2, ''),
    ],
)
def test_an_executable_of_ros2_run_runs_the_command(words: list[str], code: int, out: str) -> None:
    name, *options = words
    process = subprocess.run(
        [str(EXECUTABLES / name), *options],
        capture_output=True,
        text=True,
        check=False,
        timeout=200,
    )

    assert process.returncode == code, process.stderr
    assert process.stdout.startswith(out)
