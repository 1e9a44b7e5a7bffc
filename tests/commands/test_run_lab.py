"""The runs with a user's files: `--lab`, `--model`, `--controller`, `--relay`."""

from __future__ import annotations

import signal
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pytest
from student_code import WORKS
from user_files import replaced, user_text

pytest.importorskip('rclpy')

from command_line import barc, printed

from barc_sim.bags import reader as bag
from barc_sim.bags.recovery import recover
from barc_sim.simulation.metrics import summary

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Callable
    from pathlib import Path

    Start = Callable[..., subprocess.Popen[str]]

MAX = ('--realtime-factor', 'max')
pytestmark = pytest.mark.usefixtures('ros_domain', 'here')

PID = user_text('proportional_controller.py')


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def start(start: Start) -> Start:
    """Return a function that starts a run, which is gone after the test."""
    return partial(start, '-m', 'barc_sim.run')


def pid_with(line: str) -> str:
    """Return the controller with a line of Python before it answers."""
    return replaced(PID, ('        return', f'        {line}\n        return'))


def lab(folder: Path, **files: str) -> Path:
    folder.mkdir()
    for name, text in files.items():
        (folder / f'{name}.py').write_text(text)
    return folder


def test_the_users_class_gets_the_gains_and_the_bag_its_files(tmp_path: Path) -> None:
    text = "print('loaded')\nimport gain\n" + pid_with('print(1)')
    folder = lab(tmp_path / 'lab', controller=text, gain='')
    words = ('-q', *MAX, '--distance', '1', '--kp', '0.5', '--lab', 'lab')
    process = barc('acc', *words)
    path = bag.newest(tmp_path / 'bags')
    # Quiet, it prints nothing of theirs.
    assert (process.returncode, process.stdout) == (0, f'{path.relative_to(tmp_path)}\n')

    log = bag.read(path)
    assert np.array_equal(log.motor, 0.5 * (8.0 - log.v_x))
    assert np.isnan(log.proportional).all()

    names = ('controller.py', 'gain.py')
    expected = {f'student/{name}': (folder / name).read_bytes() for name in names}
    assert bag.load(path).attachments == expected


def test_the_labs_published_law_drives_as_published(tmp_path: Path) -> None:
    work = WORKS['the published law']
    lab(tmp_path / 'lab', bike_model=work.model, controller=work.controller)
    out = printed('acc', *MAX, '--lab', 'lab')
    assert 'tolerated   bike_model.py: tabs and spaces are mixed' in out
    assert 'kp 10, ki 0.5, kd 0.4 (controller.py, line ' in out
    assert ', without a limit' in out

    log = bag.read(bag.newest(tmp_path / 'bags'))
    assert log.motor[0] > 80.0

    errors = summary(log)
    assert errors.rms_error_after_run_up == pytest.approx(0.101, abs=0.0005)
    assert errors.max_error_after_run_up == pytest.approx(0.367, abs=0.0005)


def test_a_runaway_car_ends_the_run(tmp_path: Path) -> None:
    wrong_sign = replaced(PID, ('_reference - speed_current', '_current - 8.0'))
    lab(tmp_path / 'lab', controller=wrong_sign)
    process = barc('acc', *MAX, '--lab', 'lab', '--kp', '10')
    assert process.returncode == 1
    assert 'the error is speed_reference - speed_current; at -1090 m/s it is given up' in (
        process.stderr
    )


@pytest.mark.parametrize(
    ('command', 'name', 'text', 'sentence', 'states'),
    [
        (
            'acc',
            'controller',
            pid_with('assert self.calls < 30'),
            'controller.py, line 8: acc_calculate(speed_reference=8.0, speed_current=',
            30,
        ),
        (
            'acc',
            'controller',
            pid_with('while self.calls == 20: pass'),
            'controller.py, line 8: acc_calculate(speed_reference=8.0, speed_current=',
            20,
        ),
        (
            'acc',
            'bike_model',
            'def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):\n    return [x, y, psi]\n',
            'bike_model.py, line 1: bikeFE(x=0.0, y=0.0',
            1,
        ),
        (
            'teleop --view none',
            'relay',
            'def relay(linear_x, angular_z):\n    return linear_x\n',
            'relay.py, line 1: relay(linear_x=0.0, angular_z=0.0) returned 0.0',
            None,
        ),
    ],
    ids=['controller', 'loop without end', 'model', 'relay'],
)
def test_the_bag_has_all_states_before_an_error_of_the_users_code(
    tmp_path: Path,
    command: str,
    name: str,
    text: str,
    sentence: str,
    states: int | None,
) -> None:
    lab(tmp_path / 'lab', **{name: text})
    lock_step = MAX if states else ()
    process = barc(*command.split(), '-q', *lock_step, '--lab', 'lab')
    path = bag.newest(tmp_path / 'bags')
    assert (process.returncode, process.stdout) == (1, f'{path.relative_to(tmp_path)}\n')
    assert f'barc {command.split(maxsplit=1)[0]}: error: {sentence}' in process.stderr
    assert 'Traceback' not in process.stderr

    information = bag.info(path)
    assert information['failure'].startswith(sentence)
    assert f'student/{name}.py' in bag.load(path).attachments

    if states:
        assert (len(bag.read(path)), information['steps']) == (states, str(states))


@pytest.mark.parametrize(
    ('options', 'words'),
    [
        ('--lab none', "there is no folder 'none'"),
        ('--lab broken/controller.py', 'is a file: name the folder that it is in'),
        (
            '--lab empty',
            "'empty' has no bike_model.py, controller.py, lane.py, raceline.py, identify.py: ",
        ),
        ('--lab broken', 'controller.py, line 1: syntax error'),
        ('--model broken/controller.py', 'controller.py, line 1: syntax error'),
        ('--controller none.py', 'cannot be read: No such file'),
        ('--lab rospy', 'controller.py defines no PID'),
        ('--lab line', 'raceline.py is for a track'),
        ('--relay broken/controller.py', '--relay'),
        ('--lab identify --kp 3', '--kp and identify.py both drive: give one of the two only'),
        ('--lab identify --speed 3', '--speed and identify.py both drive'),
    ],
)
def test_files_that_cannot_be_used_leave_no_bag(tmp_path: Path, options: str, words: str) -> None:
    lab(tmp_path / 'broken', controller='def (')
    lab(tmp_path / 'rospy', controller='import rospy\n')
    lab(tmp_path / 'line', raceline='def line(x, y, psi, half): return 0.0 * x\n')
    lab(tmp_path / 'empty')
    lab(tmp_path / 'identify', identify='def command(t): return 1.0\n')
    process = barc('acc', '-q', *options.split())

    assert (process.returncode, process.stdout) == (2, '')
    assert words in process.stderr
    assert process.stderr.count('\n') == 1
    assert not (tmp_path / 'bags').exists()


def test_files_of_a_track_beside_a_controller_do_not_matter_on_a_road(tmp_path: Path) -> None:
    lane = 'class Lane:\n    def steer_calculate(self, e_y, e_psi, speed, curvature): return 0.0\n'
    raceline = 'def line(x, y, psi, half): return 0.0 * x\n'
    lab(tmp_path / 'lab', controller=PID, lane=lane, raceline=raceline)
    process = barc('acc', '-q', *MAX, '--distance', '1', '--lab', 'lab')
    assert (process.returncode, process.stderr) == (0, '')


def test_a_drive_with_commands_of_the_users_has_no_reference(tmp_path: Path) -> None:
    code = "NAME = 'Ann'\n\ndef command(t): return 1.0\n\ndef estimate(t, v, a): return [0.0] * 6\n"
    lab(tmp_path / 'lab', identify=code)
    process = barc('acc', '-q', *MAX, '--road', 'flat', '--distance', '5', '--lab', 'lab')
    assert process.returncode == 0, process.stderr
    log = bag.read(tmp_path / process.stdout.strip())
    assert np.isnan(log.reference).all()
    assert log.motor[0] == 1.0


def test_a_killed_run_has_its_code_in_the_bag_before_and_after_recovery(
    start: Start, tmp_path: Path
) -> None:
    folder = lab(tmp_path / 'lab', controller=PID)
    process = start('acc', '--lab', 'lab', '--distance', '0')
    assert process.stdout
    assert process.stdout.readline().startswith('engine ')
    assert ' m/s ' in process.stdout.readline()

    process.send_signal(signal.SIGKILL)
    process.wait()
    path = bag.newest(tmp_path / 'bags')
    expected = {'student/controller.py': (folder / 'controller.py').read_bytes()}
    assert bag.load(path).attachments == expected

    recover(path, tmp_path / 'whole')
    assert bag.load(tmp_path / 'whole').attachments == expected


def test_a_relay_drives(start: Start, tmp_path: Path) -> None:
    lab(tmp_path / 'lab', relay='def relay(linear_x, angular_z):\n    return 2.5, 0.25\n')
    process = start('teleop', '--view', 'none', '--relay', 'lab/relay.py')
    assert process.stdout
    for line in process.stdout:
        if ' m/s ' in line and 'speed   0.00' not in line:
            break
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=200)
    log = bag.read(bag.newest(tmp_path / 'bags'))

    assert process.returncode == 0
    assert {2.5, 0.25} <= {*log.motor.tolist(), *log.servo.tolist()}


def test_gains_of_either_sign_drive_as_in_check(tmp_path: Path) -> None:
    reversed_error = ('speed_reference - speed_current', 'speed_current - speed_reference')
    text = replaced(PID, reversed_error)
    folder = lab(tmp_path / 'lab', controller=f'{text}\n\npid = PID(-3, 0, 0)\n')

    out = printed('acc', *MAX, '--no-bag', '--lab', str(folder))
    assert 'controller  kp -3, ki 0, kd 0 (controller.py, line ' in out
