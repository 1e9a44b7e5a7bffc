"""The check command: what it prints, its figure, and its exit code."""

from __future__ import annotations

from io import StringIO
from typing import TYPE_CHECKING

import pytest
from command_line import printed, refused
from rich.console import Console
from user_files import CONTROLLER as RIGHT
from user_files import MODEL, replaced, user_text

from barc_sim.__main__ import main as barc
from barc_sim.commands.check import print_findings
from barc_sim.lab.grade.grade import load_rubric
from barc_sim.lab.labs.hills import HILLS

if TYPE_CHECKING:
    from pathlib import Path

#: A controller that has only P, and prints.
PROPORTIONAL = replaced(
    user_text('proportional_controller.py'),
    ('self.calls += 1', "print('[red]called')"),
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with a right model and no controller."""
    path = tmp_path / 'my_lab'
    path.mkdir()
    (path / 'bike_model.py').write_text(MODEL, encoding='utf-8')
    return path


@pytest.fixture
def wrong(folder: Path) -> Path:
    """Return a folder with a right model, and a controller that has only P."""
    (folder / 'controller.py').write_text(
        f'{PROPORTIONAL}\n\npid = PID(2, 0, 0)\n', encoding='utf-8'
    )
    return folder


def test_a_rubric_of_another_lab_is_refused(folder: Path) -> None:
    assert "'lane' judges lane.py: the folder " in refused('check', str(folder), '--rubric', 'lane')


def test_right_code_gives_exit_code_0_and_a_figure(folder: Path) -> None:
    (folder / 'controller.py').write_text(RIGHT, encoding='utf-8')
    lines = printed('check', str(folder)).splitlines()

    assert lines[:2] == [
        'criterion          points  finding',
        'model.x             9 / 9  right in all 2,750 cases',
    ]
    assert lines[-2:] == [
        '8 of 8 criteria are met in full: 100 of 100 points',
        str(folder / 'check.png'),
    ]
    assert (folder / 'check.png').read_bytes().startswith(b'\x89PNG')


def test_wrong_code_gives_exit_code_1_and_the_reasons(wrong: Path) -> None:
    out = printed('check', str(wrong), '--no-plot', code=1)
    assert ': I is always 0: is ki used, and is each error' in out
    assert 'from   grade        RMS    maximum  remark\n' in out
    assert '100 m    30°  2.163 m/s  2.448 m/s  2.44 m/s too slow' in out
    assert 'your code printed:\n  [red]called\n' in out
    assert '… and more' in out
    assert '5 of 8 criteria are met in full: ' in out
    assert not (wrong / 'check.png').exists()


def test_criteria_of_a_file_that_is_not_there_are_not_met(wrong: Path) -> None:
    (wrong / 'controller.py').unlink()
    out = printed('check', str(wrong), '--no-plot')
    assert '4 of 8 criteria are met in full: 50 of 100 points' in out


def test_a_cause_is_named_once(wrong: Path) -> None:
    (wrong / 'bike_model.py').write_text(replaced(MODEL, ('= atan', '= -atan')), encoding='utf-8')
    out = printed('check', str(wrong), '--no-plot', code=1)
    assert out.count('is the sign of beta right?') == 1
    assert '  see model.x\n' in out


def test_calls_that_fail_alike_are_one_cause(wrong: Path) -> None:
    file = wrong / 'controller.py'
    file.write_text(replaced(file.read_text(), ('return ', 'return nothing + ')), encoding='utf-8')
    out = printed('check', str(wrong), '--no-plot', code=1)
    assert out.count("name 'nothing' is not defined") == 1
    assert out.count('  see pid.proportional\n') == 3


def test_in_a_terminal_there_are_tables(wrong: Path) -> None:
    out = StringIO()
    console = Console(file=out, force_terminal=True, color_system=None, width=100)
    print_findings(HILLS.judge_folder(wrong, load_rubric().settings), load_rubric(), console)
    text = out.getvalue()
    assert text.splitlines()[0].split() == ['criterion', 'points', 'finding']
    assert "the lab's road, stretch by stretch" in text
    assert '[red]called' in text
    assert max(map(len, text.splitlines())) <= 100


def test_in_a_narrow_terminal_nothing_is_cut_off(wrong: Path) -> None:
    file = wrong / 'controller.py'
    file.write_text(replaced(file.read_text(), ('return ', 'return nothing + ')), encoding='utf-8')
    out = StringIO()
    console = Console(file=out, force_terminal=True, color_system=None, width=60)
    print_findings(HILLS.judge_folder(wrong, load_rubric().settings), load_rubric(), console)
    assert '…' not in out.getvalue().replace('… and more', '')


def test_the_figure_is_saved_as_asked(wrong: Path, tmp_path: Path) -> None:
    assert barc(['check', str(wrong), '--save', str(tmp_path / 'a.svg')]) == 1
    assert (tmp_path / 'a.svg').stat().st_size > 1000
    assert not (wrong / 'check.png').exists()


@pytest.mark.parametrize(
    ('args', 'complaint'),
    [
        (['missing'], "there is no folder 'missing'"),
        (['.'], "the folder '.' has no bike_model.py, controller.py, relay.py"),
        (['my_lab', '--save', 'a.jpeg'], "'a.jpeg': the name must end in"),
        (['my_lab', '--save', 'a.png', '--no-plot'], 'contradict each other'),
    ],
)
@pytest.mark.usefixtures('folder')
def test_a_mistake_in_the_command_is_one_line_and_exit_code_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, args: list[str], complaint: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert complaint in refused('check', *args)


def test_where_nothing_is_valid_no_figure_is_drawn(folder: Path) -> None:
    (folder / 'bike_model.py').write_text('def bikeFE(*a): return None\n')
    (folder / 'controller.py').write_text('class PID: pass\n')

    assert barc(['check', str(folder)]) == 1
    assert not (folder / 'check.png').exists()
