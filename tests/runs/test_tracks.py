"""`acc --track`: laps over every carrier, as in Python; its summary, its bag and its refusals."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

from command_line import call
from user_files import user_text

from barc_sim.bags.contents import Contents
from barc_sim.bags.reader import read
from barc_sim.control.cruise_control import LANE_TYPES
from barc_sim.control.lane import LaneLQR, Stanley, speed_profile
from barc_sim.simulation.closed_loop import lap
from barc_sim.simulation.log import TrackLog
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from pathlib import Path

LANE = user_text('lane_with_sum.py')
CIRCLE = 'length_m,radius_m\n31.41592653589793,5\n'
FAST = ('--realtime-factor', 'max', '--view', 'none')


def drive(folder: Path, *words: str, engine: str = 'local') -> tuple[str, TrackLog]:
    """Return what a run prints, and the log of its bag."""
    process = call('acc', '--engine', engine, '--view', 'none', *words, cwd=folder)
    assert process.returncode == 0, process.stderr
    log = read(max((folder / 'bags').iterdir()))
    assert isinstance(log, TrackLog)
    return process.stdout, log


@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize(
    ('engine', 'factor'),
    [('local', 'max'), ('ros', 'max'), pytest.param('ros', '0.25', marks=pytest.mark.slow)],
)
def test_a_lap_has_the_states_of_python_to_the_last_bit_on_every_carrier(
    tmp_path: Path, engine: str, factor: str
) -> None:
    (tmp_path / 'circle.csv').write_text(CIRCLE, 'utf-8')
    # By the clock, a busy machine keeps a deadline of 80 ms; that of 20 ms it may miss.
    words = '--track circle.csv --lane stanley --speed 8 --lane-gain k=3 --dynamics dynamic'
    factors = ('--realtime-factor', factor)
    printed, log = drive(tmp_path, *words.split(), *factors, engine=engine)
    track = Track.named(str(tmp_path / 'circle.csv'))
    expected = lap(Stanley(k=3.0), track, speed=8.0, laps=1, dynamics='dynamic')

    for name in ('s', 'e_y', 'servo', 'motor', 'lap_time', 'steer_of_e_y'):
        assert log.columns()[name].tolist() == expected.columns()[name].tolist(), name
    assert (log, log.track) == (expected, replace(track, name='circle.csv'))
    assert not log.missed.any()
    assert 'missed deadlines 0' in printed


@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize(('law', 'engine'), [('mpc', 'ros'), ('speed-mpc', 'local')])
def test_predictive_control_drives_the_states_of_python_to_the_last_bit(
    tmp_path: Path, law: str, engine: str
) -> None:
    """All but the time that it takes, which is measured."""
    pytest.importorskip('daqp')
    (tmp_path / 'circle.csv').write_text(CIRCLE, 'utf-8')
    words = f'--track circle.csv --lane {law} --lane-gain q_e_y=0.3'.split()
    _, log = drive(tmp_path, *words, '--realtime-factor', 'max', engine=engine)
    track = Track.named(str(tmp_path / 'circle.csv'))
    expected = lap(LANE_TYPES[law](q_e_y=0.3), track, speed=8.0, laps=1).columns()
    assert log.own_terms.keys() == {'lane.solve_time', 'lane.infeasible'}
    for name in log.columns().keys() - {'lane.solve_time'}:
        assert log.columns()[name].tobytes() == expected[name].tobytes(), name

    messages = Contents(max((tmp_path / 'bags').iterdir())).messages()
    plans = sum(message.topic.name == '/prediction' for message in messages)
    assert plans == pytest.approx(len(log) / 5, abs=1)


def test_laps_follow_one_another_and_are_listed(tmp_path: Path) -> None:
    words = ('--track', 'oval', '--speed', '12', '--speed-profile', '3.2', '2', '--laps', '2')
    printed, log = drive(tmp_path, *words, *FAST, '--road', 'lab')
    profile = speed_profile(Track.named('oval'), 12.0, 3.2, 2.0)
    expected = lap(LaneLQR(), 'oval', speed=profile, laps=2, road='lab')
    assert log == expected

    row = r'^\d +([\d.]+) s +[\d.]+ m +[\d.]+ m +\d+% at its limit$'
    times = re.findall(row, printed, re.MULTILINE)
    assert times == [f'{time:.2f}' for time in expected.lap_times]
    assert f'best lap {expected.best:.2f} s' in printed


def test_a_users_steering_law_drives(tmp_path: Path) -> None:
    (tmp_path / 'lane.py').write_text(LANE, 'utf-8')
    words = ('--track', 'circle', '--speed', '6', '--lab', '.', *FAST)
    _, log = drive(tmp_path, *words, '--lane-gain', 'k_y=0.3')
    assert (log.steer_feedforward == 3.0 * (1.0 / 20.0)).all()
    _, other = drive(tmp_path, *words)
    assert other != log


def test_the_run_of_a_car_that_leaves_the_track_ends(tmp_path: Path) -> None:
    (tmp_path / 'lane.py').write_text(LANE.replace('return', 'return 0.0  #'), 'utf-8')
    process = call(
        'acc', '--engine', 'local', '--track', 'circle', '--lab', '.', *FAST, cwd=tmp_path
    )
    assert process.returncode == 1
    assert 'the car left the track to the right at 10.4 m: the run' in process.stderr
    assert re.search(r'^not finished +\d+\.\d\d s', process.stdout, re.MULTILINE)


@pytest.mark.parametrize(
    ('words', 'complaint'),
    [
        ('--track M', "track 'M' is neither 'L', 'oval', 'circle', 'figure-eight' nor a CSV"),
        ('--lane lqr', '--lane is for a track: give one, as in --track L'),
        ('--lane-gain q_e_y=1', '--lane-gain is for a track'),
        ('--speed-profile 3 2', '--speed-profile is for a track'),
        ('--lab .', 'lane.py is for a track'),
        ('--track L --lane pid', "invalid choice: 'pid'"),
        ('--track L --lane lane.py', "'lane.py' is a file: name the folder of your lane.py with"),
        ('--track L --lane-gain k=1', 'k: this controller has no such gain, but q_e_y, q_e_psi'),
        ('--track L --lane-gain q_e_y=0', 'q_e_y: 0 is not a number from 1e-06 to 1000'),
        ('--track L --lane speed-mpc --speed 6', '--speed and speed-mpc both drive: give one of'),
        ('--track L --lane lqr --lab .', '--lab gives lane.py: give one of the two only'),
        (
            '--track L --lab . --lane-gain k=1',
            'k: this controller has no such gain, but k_',
        ),
        ('--track L --speed-profile 3 2 --reference a.csv', 'both give the speed: give one'),
        ('--track open.csv --laps 2', "track 'open.csv' is not closed: expected laps 1, not 2"),
        ('--track L --laps -1', '-1 is not a whole number from 0'),
        (
            '--track L --lab wanting',
            'lane.py, line 2: Lane takes (k), and a run passes none: expected a default',
        ),
    ],
)
def test_options_that_do_not_fit_the_track_are_refused_in_a_sentence(
    tmp_path: Path, words: str, complaint: str
) -> None:
    (tmp_path / 'lane.py').write_text(LANE, 'utf-8')
    (tmp_path / 'wanting').mkdir()
    (tmp_path / 'wanting/lane.py').write_text(LANE.replace('k_y=0.2, k_psi=0.8', 'k'), 'utf-8')
    (tmp_path / 'open.csv').write_text('length_m,radius_m\n50,0\n', 'utf-8')
    process = call('acc', '--engine', 'local', *FAST, *words.split(), cwd=tmp_path)

    assert process.returncode != 0
    assert complaint in process.stderr
    assert len(process.stderr.strip().splitlines()) == 1
    assert not (tmp_path / 'bags').exists()
