"""The tune command."""

from __future__ import annotations

import os
import shlex
import signal
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from command_line import ENVIRONMENT, printed, refused, started, wait_for

from barc_sim.__main__ import main as barc
from barc_sim.__main__ import parse
from barc_sim.control.speed import NO_LIMIT, speed_controller
from barc_sim.lab.user_code.adapters import controller_of
from barc_sim.simulation.closed_loop import closed_loop, simulate
from barc_sim.simulation.metrics import summary
from barc_sim.tuning import search

if TYPE_CHECKING:
    Capture = pytest.CaptureFixture[str]

#: A small search.
QUICK = [
    *('--distance', '30', '--kp-range', '10', '50'),
    *('--ki-range', '0', '900', '--kd-range', '0', '0'),
]


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, 'search', partial(search.search, population=12, generations=3))


def command_of(out: str) -> list[str]:
    (line,) = [line for line in out.splitlines() if 'bin/barc acc --road ' in line]
    return shlex.split(line)[2:]


def test_the_printed_command_drives_with_the_cost_of_the_table(capsys: Capture) -> None:
    assert barc(['tune', '--seed', '3']) == 0

    captured = capsys.readouterr()
    assert captured.err == ''

    options = parse('acc', command_of(captured.out))
    log = closed_loop(controller=speed_controller(options.kp, options.ki, options.kd))
    rms = summary(log).rms_error_after_run_up
    (cost,) = [line.split() for line in captured.out.splitlines() if line.startswith('cost: rms')]
    assert float(cost[-1]) == pytest.approx(rms, rel=1e-4)
    assert float(cost[-1]) < float(cost[-2]) == pytest.approx(0.020692)


def test_the_printed_command_has_the_options_of_the_search() -> None:
    args = ['--road', 'flat', '--speed', '6', '--noise', '0.05', '--delay', '0.055', '--seed', '4']
    line = command_of(printed('tune', *QUICK, *args, '--sensor-delay', '0.04'))
    assert line[:2] == ['--road', 'flat']
    assert line[line.index('--speed') :] == [
        *('--speed', '6', '--distance', '30', '--seed', '4'),
        *('--ros-args', '-p', 'vehicle_simulator:noise_v_x:=0.05'),
        *('-p', 'vehicle_simulator:motor_delay:=0.055'),
        *('-p', 'vehicle_simulator:sensor_delay:=0.04'),
    ]


def test_gains_are_tuned_for_a_sensor_that_measures_late() -> None:
    lines = printed('tune', *QUICK, '--road', 'flat', '--sensor-delay', '0.04')
    found = float(_row(lines, 'kp')[1])
    ki = float(_row(lines, 'ki')[1])
    run = simulate(found, ki, 0.0, road='flat', distance=30.0, sensor_delay=0.04)
    cost = float(_row(lines, 'cost: rms')[1])
    assert cost == pytest.approx(summary(run).rms_error_after_run_up, rel=1e-3)


def test_of_several_roads_each_has_a_table_and_a_line(tmp_path: Path) -> None:
    road = tmp_path / 'my hill.csv'
    road.write_text('start_m,grade_deg\n0,0\n15,8\n')
    lines = printed('tune', *QUICK, '--road', 'flat', str(road), '--road', 'lab').splitlines()
    assert sum(line.startswith('road ') for line in lines) == 3
    commands = [shlex.split(line) for line in lines if ' acc ' in line]
    assert [line[2:4] for line in commands] == [
        ['--road', each] for each in ('flat', str(road), 'lab')
    ]


def test_a_users_controller_is_tuned(tmp_path: Path) -> None:
    path = tmp_path / 'my controller.py'
    path.write_text(
        'class PID:\n'
        '    def __init__(self, kp, ki, kd): self.kp = kp\n'
        '    def acc_calculate(self, r, v): return self.kp * (r - v)\n'
        'pid = PID(kp=12.0, ki=0.0, kd=0.0)\n'
    )
    args = ['--controller', str(path), '--road', 'flat']
    out = printed('tune', *QUICK, *args)
    assert command_of(out)[-2:] == ['--controller', str(path)]

    start, best = (float(each) for each in _row(out, 'kp'))
    assert start == 12.0  # the file chooses it

    # As in a run with it, there is no limit of acceleration.
    for kp, cost in zip((start, best), _row(out, 'cost: rms'), strict=True):
        ways = {'road': 'flat', 'distance': 30.0, 'acceleration_limit': NO_LIMIT}
        controller = controller_of(path)
        controller.kp = kp
        log = simulate(controller=controller, **ways)
        assert float(cost) == pytest.approx(summary(log).rms_error_after_run_up, rel=1e-3)


def _row(out: str, label: str) -> list[str]:
    (line,) = [line for line in out.splitlines() if line.startswith(label)]
    return line.removeprefix(label).split()


@pytest.mark.parametrize(
    ('args', 'complaint'),
    [
        (['--cost', 'speed'], "invalid choice: 'speed'"),
        (['--road', 'nowhere.csv'], "road 'nowhere.csv' is neither"),
        (['--kp-range', '5', '1'], '--kp-range 5 1 must have the lower number first'),
        (['--kp-range', '0', '0', '--ki-range', '0', '0'], 'no gains in these ranges drive'),
        (['--controller', 'nowhere.py'], "nowhere.py' cannot be read"),
        (['--delay', '11'], '11 is not a number from 0 to 10'),
        (['--kp-range', '1'], 'expected 2 arguments'),
        (['--ki-range', '0', 'inf'], 'inf is not a number from 0 to 1e+06'),
    ],
)
def test_tune_refuses_a_mistake_in_one_sentence(args: list[str], complaint: str) -> None:
    assert complaint in refused('tune', *QUICK, *args)


#: A controller of two files.
_FILES = {
    'controller.py': (
        'from law import law\n'
        'class PID:\n'
        '    def __init__(self, kp, ki, kd): self.kp = kp\n'
        '    def acc_calculate(self, r, v): return law(self.kp, r - v)\n'
    ),
    'law.py': 'def law(kp, error): return kp * error\n',
}
#: Options of a search that takes a user's controller.
_P_ONLY = ('--distance', '20', '--ki-range', '0', '0', '--kd-range', '0', '0')


def without_duration(out: str) -> list[str]:
    """Return the lines of a search, but for the one with its duration."""
    return [line for line in out.splitlines() if ' closed loops per road in ' not in line]


def test_processes_find_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # where the road is
    (tmp_path / 'hill.csv').write_text('start_m,grade_deg\n0,0\n15,8\n')
    words = ['tune', *QUICK, '--road', 'hill.csv', 'flat', '--noise', '0.1']
    alone = without_duration(printed(*words))
    assert without_duration(printed(*words, '--jobs', '2')) == alone
    assert alone[0].startswith('road hill.csv')


def test_processes_find_the_same_for_a_users_controller(tmp_path: Path) -> None:
    for name, text in _FILES.items():
        (tmp_path / name).write_text(text)
    words = ['tune', *_P_ONLY, '--controller', str(tmp_path / 'controller.py')]
    alone = without_duration(printed(*words))
    assert without_duration(printed(*words, '--jobs', '2')) == alone


def test_a_controller_that_fails_on_a_worker_is_refused_in_the_same_sentence(
    tmp_path: Path,
) -> None:
    path = tmp_path / 'controller.py'
    path.write_text(_FILES['controller.py'].replace('law(self.kp, r - v)', '1.0 / (v - v)'))
    (tmp_path / 'law.py').write_text(_FILES['law.py'])
    words = ('tune', *_P_ONLY, '--controller', str(path))
    here = refused(*words)
    assert 'controller.py, line 4' in here
    assert refused(*words, '--jobs', '1') == here


def processes_of(session: int) -> list[str]:
    """Return the processes of a session, but for its leader."""
    numbers = []
    for entry in Path('/proc').glob('[0-9]*'):
        with suppress(OSError):
            if os.getsid(int(entry.name)) == session != int(entry.name):
                numbers.append(entry.name)
    return numbers


@pytest.mark.slow
def test_ctrl_c_ends_the_search_and_its_workers(tmp_path: Path) -> None:
    begun = tmp_path / 'begun'
    (tmp_path / 'tmp').mkdir()
    (tmp_path / 'controller.py').write_text(
        'import pathlib, time\n'
        'class PID:\n'
        '    def __init__(self, kp, ki, kd): pass\n'
        '    def acc_calculate(self, r, v):\n'
        f'        pathlib.Path({str(begun)!r}).touch()\n'
        '        time.sleep(0.5)\n'
        '        return 0.0\n'
    )
    with started(
        *('tune', *_P_ONLY, '--controller', 'controller.py', '--jobs', '2'),
        cwd=tmp_path,
        env=os.environ | ENVIRONMENT | {'TMPDIR': str(tmp_path / 'tmp')},
        start_new_session=True,
    ) as process:
        wait_for(begun.exists)
        os.killpg(process.pid, signal.SIGINT)
        out, errors = process.communicate(timeout=200)
        wait_for(lambda: not processes_of(process.pid))

    assert (process.returncode, out) == (130, '')
    assert errors == 'barc tune: interrupted\n'
    assert not [*(tmp_path / 'tmp').iterdir()]
