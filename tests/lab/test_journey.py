"""A student's way through the lab, from the templates to the grade."""

from __future__ import annotations

import csv
import io
import json
import re
import subprocess
import sys
import zipfile
from typing import TYPE_CHECKING

import numpy as np
import pytest
from command_line import barc
from terminal_session import READY, Session
from user_files import IDENTIFY, LANE, MODEL, RACELINE, user_text

from barc_sim.bags.reader import newest, read
from barc_sim.lab.labs.identify import car_of

if TYPE_CHECKING:
    from pathlib import Path

CONTROLLER = user_text('pid_of_journey.py')
CALL = '\n\npid = PID(kp=10, ki=20, kd=0.1)\n'
RELAY = 'def relay(linear_x, angular_z):\n    return [8.0 * linear_x, 0.3 * angular_z]\n'
ENGINE = ('--engine', 'local', '--realtime-factor')
FAST = (*ENGINE, 'max')
#: The keys with arrows.
UP, LEFT = b'\x1b[A', b'\x1b[D'


def output_of(*words: str) -> str:
    """Run a command, which must succeed, and return its output."""
    process = barc(*words)
    assert process.returncode == 0, process.stderr
    return process.stdout


def drive_by_hand(folder: Path) -> None:
    """Drive forward, then to the left, in a terminal."""
    session = Session(folder, '--lab', 'my_lab', '--view', 'none', *ENGINE, '4')
    try:
        session.until(READY)
        session.hold(UP, 0.7)
        session.hold(LEFT, 0.7)
        session.type(b'q')
        assert session.end() == 0, session.shown.decode()
    finally:
        session.close()


@pytest.mark.slow
@pytest.mark.usefixtures('confinement')
def test_from_the_templates_to_the_grade(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    lab = tmp_path / 'my_lab'

    # The templates: all is still to be written, and each command names it.
    assert 'write bike_model.py' in output_of('new', 'my_lab')
    fresh = barc('check', 'my_lab')
    assert (fresh.returncode, 'is not written yet (TODO)' in fresh.stdout) == (1, True)
    failed = barc('acc', '--lab', 'my_lab', *FAST)
    assert (failed.returncode, 'is not written yet (TODO)' in failed.stderr) == (1, True)

    # Task 1: the model.
    (lab / 'bike_model.py').write_text(MODEL)
    assert re.search(r'model\.v +18 / 18', barc('check', 'my_lab').stdout)
    output_of('acc', '--model', 'my_lab/bike_model.py', *FAST)

    # Task 2: the controller, first without the call that chooses the gains.
    (lab / 'controller.py').write_text(CONTROLLER)
    unchosen = barc('check', 'my_lab')
    assert (unchosen.returncode, 'chooses no gains' in unchosen.stdout) == (1, True)

    (lab / 'controller.py').write_text(CONTROLLER + CALL)
    assert '8 of 8 criteria are met in full: 100 of 100 points' in output_of('check', 'my_lab')
    assert 'kp 10, ki 20, kd 0.1 (controller.py, line 15), without a limit' in output_of(
        'acc', '--lab', 'my_lab', *FAST
    )
    assert output_of('plot').strip().endswith('speed.png')
    assert output_of('report').strip().endswith('report.html')

    # Task 3: the drive by hand.
    (lab / 'relay.py').write_text(RELAY)
    drive_by_hand(tmp_path)
    teleop = str(newest())
    log_by_hand = read(teleop)
    assert log_by_hand.v_x.max() > 3.0
    assert log_by_hand.psi.max() > 0.1  # to the left
    output_of('replay', teleop, '--save', 'my_lab/drive.gif')

    # What is handed in.
    (lab / 'description.md').write_text('A PID with gains by trial.\n')
    summary = output_of('submit', 'my_lab')
    assert [line for line in summary.splitlines() if 'missing' in line] == [
        'code          missing: compose.py is still the template'
    ]
    with zipfile.ZipFile('my_lab.zip') as archive:
        assert archive.testzip() is None
        assert {'report.html', 'teleop.html', 'drive.gif'} <= {*archive.namelist()}

    # The instructor.
    (tmp_path / 'class').mkdir()
    (tmp_path / 'my_lab.zip').rename(tmp_path / 'class' / 'ada.zip')
    (tmp_path / 'class' / 'bob').mkdir()
    assert '100.00' not in output_of('grade', 'class', '--jobs', '2')

    rows = csv.DictReader(io.StringIO((tmp_path / 'grades' / 'class.csv').read_text()))
    ada, bob = rows
    assert (ada['name'], ada['score'], ada['remark']) == ('ada.zip', '120.0', '')
    assert (bob['score'], bob['remark'].endswith('there is no controller.py')) == ('0.0', True)

    results = json.loads((tmp_path / 'grades' / 'ada.zip' / 'results.json').read_text())
    assert 'gains: kp 10, ki 20, kd 0.1 (controller.py, line 15)' in results['output']


#: By lab: a right file, its criteria here, the one that a person judges, and what submit prints.
LABS = {
    '3': ('lane.py', LANE, 10, 'lane.delay', r'3 laps; maximum e_y 0.1\d m'),
    # Along the line: of a car in the middle of L, |e_y| would be 1.8 m.
    '4': ('raceline.py', RACELINE, 7, 'line.gain', r'3 laps; maximum e_y 0.1\d m'),
    '5': ('identify.py', IDENTIFY, 8, 'estimate.residuals', r'course +[\d.]+ m in [\d.]+ s\n'),
}


@pytest.mark.slow
@pytest.mark.usefixtures('confinement')
@pytest.mark.parametrize('number', LABS)
def test_labs_3_to_5_work_from_the_template_to_the_grade(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: str
) -> None:
    monkeypatch.chdir(tmp_path)
    file, right, count, by_eye, drive = LABS[number]
    assert f'write {file}' in output_of('new', '--lab', number, 'mine')
    fresh = barc('check', 'mine')
    assert fresh.returncode == 1
    assert f'0 of {count} criteria are met in full: 0 of 100 points, 10 still open' in fresh.stdout

    (tmp_path / 'mine' / file).write_text(right)
    checked = output_of('check', 'mine')
    assert f'{count} of {count} criteria are met in full: 90 of 100 points, 10 still' in checked
    assert (tmp_path / 'mine' / 'check.png').is_file()
    (tmp_path / 'mine' / 'description.md').write_text('It is as expected.')
    summary = output_of('submit', 'mine')
    assert 'missing' not in summary
    assert re.search(drive, summary)

    (tmp_path / 'class').mkdir()
    (tmp_path / 'mine.zip').rename(tmp_path / 'class' / 'ada.zip')
    assert 'Score   90.00 of 90' in output_of('grade', 'class', '--jobs', '1')
    grades = tmp_path / 'grades' / 'ada.zip'
    assert 'data:image/png' in (grades / 'report.html').read_text()
    (grades / 'by_hand.yaml').write_text(f'points:\n  {by_eye}: 8 and why?\n')
    assert 'By eye  8.00 of 10' in output_of('grade', 'class', '--jobs', '1')
    assert json.loads((grades / 'results.json').read_text())['score'] == 98.0


@pytest.mark.slow
def test_the_car_of_a_name_is_identified_from_its_drive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    output_of('new', '--lab', '5', 'mine')
    template = (tmp_path / 'mine' / 'identify.py').read_text()
    script = template[template.index("if __name__ == '__main__'") :]
    (tmp_path / 'mine' / 'identify.py').write_text(f'{IDENTIFY}\n\n{script}')
    output_of('acc', '--road', 'flat', '--distance', '0', '--lab', 'mine', *FAST)
    assert read(newest()).t[-1] == pytest.approx(60.0)

    process = subprocess.run(
        [sys.executable, 'mine/identify.py', str(newest())],
        capture_output=True,
        text=True,
        check=True,
    )
    rows = re.findall(r'^\w+ +(\S+) ± (\S+) ', process.stdout, re.MULTILINE)
    values, intervals = np.array(rows, float).T
    car = car_of('Ada Lovelace')
    assert np.all(np.abs(values - car) <= 2.0 * intervals)
