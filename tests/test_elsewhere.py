"""The lab on another system than Linux, without ROS: from the templates to what is handed in."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from command_line import call
from elsewhere import ELSEWHERE
from user_files import CONTROLLER, MODEL

from barc_sim.bags.reader import newest

if TYPE_CHECKING:
    from pathlib import Path


def barc(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run `barc`, whose stdout can hold ASCII alone."""
    return call(*words, cwd=folder, env=os.environ | ELSEWHERE, timeout=200)


def output_of(folder: Path, *words: str) -> str:
    """Return what a command prints, which must succeed."""
    process = barc(folder, *words)
    assert process.returncode == 0, process.stdout + process.stderr
    return process.stdout


def write_lab(folder: Path) -> None:
    """Write right answers as an editor of Windows does: line ends of two characters, and a mark."""
    folder.mkdir(exist_ok=True)
    for name, text in (('bike_model.py', MODEL), ('controller.py', CONTROLLER)):
        (folder / name).write_bytes(b'\xef\xbb\xbf' + text.encode().replace(b'\n', b'\r\n'))


#: As in the lab's third tutorial.
RELAY = 'def relay(linear_x, angular_z):\n    return [2.0 * linear_x, 0.3 * angular_z]\n'


def drive_by_hand(folder: Path, *options: str) -> None:
    """Run `barc teleop` until the first state is shown."""
    with subprocess.Popen(
        [sys.executable, '-m', 'barc_sim', 'teleop', *options],
        cwd=folder,
        env=os.environ | ELSEWHERE,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout
        assert any('speed' in line for line in process.stdout)
        process.send_signal(signal.SIGINT)
        process.stdout.read()
        assert process.wait(200.0) == 0


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """Return a folder whose name has what a path of Windows has."""
    folder = tmp_path / 'C:\\Users\\Zoë'
    folder.mkdir()
    return folder


@pytest.mark.slow
def test_three_tasks_from_the_templates_to_the_report(home: Path) -> None:
    output_of(home, 'new', 'my lab')
    write_lab(home / 'my lab')
    assert '8 of 8 criteria are met in full' in output_of(home, 'check', 'my lab')

    (home / 'my lab' / 'relay.py').write_text(RELAY, encoding='utf-8')
    assert '13 of 13 criteria are met in full' in output_of(home, 'check', 'my lab')

    drive_by_hand(home, '--lab', 'my lab')
    submitted = output_of(home, 'submit', 'my lab')
    assert 'course        180.' in submitted
    assert '(barc teleop --lab my lab)' in submitted.replace("'", '')
    assert 'my lab.zip' in submitted
    assert output_of(home, 'acc', '--lab', 'my lab', '--realtime-factor', 'max').startswith(
        'engine'
    )

    bag = newest(home / 'bags')
    assert output_of(home, 'plot', '--save', 'speed.png') == 'speed.png\n'
    assert 'report.html' in output_of(home, 'report')

    output_of(home, 'graph', '--bag', str(bag), '--save', 'graph.png')
    output_of(home, 'replay', '--save', 'drive.gif')
    gains = ('--kp-range', '10', '10', '--ki-range', '20', '20', '--kd-range', '0', '0')
    output_of(home, 'tune', '--controller', 'my lab/controller.py', '--distance', '20', *gains)
    (file,) = bag.glob('*.mcap')
    file.write_bytes(file.read_bytes()[:-1000])  # as if killed
    (bag / 'metadata.yaml').unlink()
    assert 'is unfinished' in output_of(home, 'recover', str(bag))


def test_grade_refuses_to_run_code_that_it_cannot_confine(home: Path) -> None:
    write_lab(home / 'ada')
    process = barc(home, 'grade', 'ada')
    (line,) = process.stderr.splitlines()
    assert process.returncode == 2
    assert 'can be confined only on Linux, and this is elsewhere: grade on Linux' in line
    assert '--unconfined' in line
    assert not (home / 'grades').exists()


def test_grade_warns_that_code_was_not_confined(home: Path) -> None:
    write_lab(home / 'ada')
    (home / 'grace').mkdir()
    (home / 'grace' / 'controller.py').write_text('import os\nos._exit(3)\n', encoding='utf-8')
    output_of(home, 'grade', '.', '--unconfined', '--out', 'grades')
    text = (home / 'grades' / 'class.csv').read_text(encoding='utf-8')
    grades = {row['name']: row for row in csv.DictReader(text.splitlines())}
    assert (grades['ada']['score'], grades['grace']['score']) == ('100.0', '0.0')

    for name, row in grades.items():
        assert 'its code ran unconfined, because of --unconfined' in row['remark']
        results = json.loads((home / 'grades' / name / 'results.json').read_text(encoding='utf-8'))
        assert 'ran unconfined' in results['output']
        page = (home / 'grades' / name / 'report.html').read_text(encoding='utf-8')
        assert 'ran unconfined' in page
