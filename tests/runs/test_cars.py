"""Several cars in one process: each drives as if it were alone."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip('rclpy')

from rosbags.highlevel import AnyReader

import barc_sim
from barc_sim.__main__ import main as barc
from barc_sim.bags import reader as bag
from barc_sim.errors import UserError
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.simulation.log import COLUMNS as ALL_COLUMNS
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.sensor import Deviation

if TYPE_CHECKING:
    from collections.abc import Sequence

ROOT = Path(barc_sim.__file__).parents[1]
COLUMNS = [name for name in ALL_COLUMNS if name != 'missed']
OWN_TOPICS = {'z_vhcl', 'ez_vhcl', 'environment', 'ecu', 'pid_state'}
pytestmark = pytest.mark.usefixtures('ros_domain')


def drive(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, '-m', 'barc_sim.run', 'acc', *options],
        cwd=folder,
        env=os.environ | {'PYTHONPATH': str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )


def bag_of(folder: Path, options: Sequence[str]) -> Path:
    done = drive(folder, '--quiet', *options)
    assert done.returncode == 0, done.stderr
    return folder / done.stdout.strip()


def test_each_car_drives_as_if_it_were_alone(tmp_path: Path) -> None:
    path = bag_of(tmp_path, ['--cars', '3', '--realtime-factor', 'max', '--distance', '60'])
    alone = closed_loop(distance=60.0)
    for number in (1, 2, 3):
        log = bag.read(path, f'/car{number}')
        for column in COLUMNS:
            np.testing.assert_array_equal(getattr(log, column), getattr(alone, column), column)


def test_each_car_has_noise_of_its_own(tmp_path: Path) -> None:
    options = ['--cars', '2', '--realtime-factor', 'max', '--distance', '10', '--seed', '7']
    path = bag_of(tmp_path, [*options, '--ros-args', '-p', 'noise_v_x:=0.1'])
    for number, seed in ((1, 7), (2, 8)):
        log = bag.read(path, f'car{number}')
        alone = closed_loop(Plant(noise=Deviation(v_x=0.1), seed=seed), distance=10.0)
        np.testing.assert_array_equal(log.v_x, alone.v_x)


def test_each_car_has_topics_of_its_own_and_one_keeps_the_clock(tmp_path: Path) -> None:
    path = bag_of(tmp_path, ['--cars', '2', '--realtime-factor', 'max', '--distance', '5'])
    with AnyReader([path]) as reader:
        counts = {name: topic.msgcount for name, topic in reader.topics.items()}
        clock = [time for _, time, _ in reader.messages(reader.topics['/clock'].connections)]
    for number in (1, 2):
        assert {f'/car{number}/{name}' for name in OWN_TOPICS} <= counts.keys()
    assert '/z_vhcl' not in counts
    assert len(clock) == counts['/car1/z_vhcl']


def test_a_line_is_printed_for_each_car(tmp_path: Path) -> None:
    done = drive(tmp_path, '--cars', '2', '--realtime-factor', 'max', '--no-bag')
    assert done.returncode == 0, done.stderr
    lines = re.findall(r'^(car\d) +([\d.]+) +([\d.]+) +(\d+)$', done.stdout, re.MULTILINE)
    assert lines == [('car1', '0.0207', '0.1263', '0'), ('car2', '0.0207', '0.1263', '0')]


def test_a_bag_of_several_cars_asks_which(tmp_path: Path) -> None:
    path = bag_of(tmp_path, ['--cars', '11', '--realtime-factor', 'max', '--distance', '0.1'])
    with pytest.raises(UserError, match=r'/car9, /car10, /car11: name one'):
        bag.read(path)


@pytest.mark.parametrize('count', ['0', '101', 'two', '-1', '1.5'])
def test_a_count_that_is_none_is_refused(tmp_path: Path, count: str) -> None:
    done = drive(tmp_path, f'--cars={count}')
    assert done.returncode == 2
    assert done.stderr.count('\n') == 1
    assert f'{count!r} is not a whole number from 1 to 100' in done.stderr


def test_each_car_is_regraded_by_its_own_parameters(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ['--cars', '2', '--realtime-factor', 'max', '--distance', '10', '--ros-args']
    path = bag_of(tmp_path, [*options, '-p', 'noise_v_x:=0.1'])
    for namespace in ('/car1', '/car2'):
        assert barc(['regrade', str(path), '--namespace', namespace]) == 0
        assert 'could have come from' in capsys.readouterr().out
    assert barc(['regrade', str(path)]) == 2
