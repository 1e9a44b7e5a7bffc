"""Several cars in one process: each drives as if it were alone."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip('rclpy')

from command_line import bag_of, printed
from rosbags.highlevel import AnyReader

from barc_sim.bags import reader as bag
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.simulation.log import COLUMNS
from barc_sim.vehicle.plant import NoiseLevels, Plant

if TYPE_CHECKING:
    from pathlib import Path

CARS = (1, 2, 3)
OWN_TOPICS = {'z_vhcl', 'ez_vhcl', 'environment', 'ecu', 'pid_state'}


@pytest.fixture(scope='module')
def path(module_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Path:  # noqa: ARG001
    """Return the bag of a run of three cars."""
    options = '--cars 3 --realtime-factor max --distance 20 --seed 7 --ros-args -p noise_v_x:=0.1'
    return bag_of(tmp_path_factory.mktemp('run'), *options.split())


def test_each_car_drives_as_if_it_were_alone_with_noise_of_its_own(path: Path) -> None:
    for number in CARS:
        log = bag.read(path, f'/car{number}')
        alone = closed_loop(Plant(noise=NoiseLevels(v_x=0.1), seed=6 + number), distance=20.0)
        for column in set(COLUMNS) - {'missed'}:
            np.testing.assert_array_equal(getattr(log, column), getattr(alone, column), column)


def test_each_car_has_topics_of_its_own_and_one_keeps_the_clock(path: Path) -> None:
    with AnyReader([path]) as reader:
        counts = {name: topic.msgcount for name, topic in reader.topics.items()}
    for number in CARS:
        assert {f'/car{number}/{name}' for name in OWN_TOPICS} <= counts.keys()
    assert '/z_vhcl' not in counts
    assert counts['/clock'] == counts['/car1/z_vhcl']


@pytest.mark.usefixtures('ros_domain')
def test_a_line_is_printed_for_each_car() -> None:
    out = printed('acc', '--cars', '2', '--realtime-factor', 'max', '--no-bag')
    lines = re.findall(r'^(car\d) +([\d.]+) +([\d.]+) +[\d.]+% +[\d.]+ *$', out, re.MULTILINE)
    assert lines == [('car1', '0.0207', '0.1263'), ('car2', '0.0207', '0.1263')]
