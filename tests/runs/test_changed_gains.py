"""Gains that change during a run are shown for the lap that had them, the same everywhere."""

from __future__ import annotations

import csv
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip('rclpy')

from command_line import printed
from rclpy.parameter import Parameter

from barc_sim import plot, read_bag
from barc_sim.bags import reader as bag
from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.simulator import VehicleSimulator
from barc_sim.simulation.closed_loop import closed_loop, simulate
from barc_sim.simulation.metrics import lap_settings_of, laps_of, summary

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from barc_sim.simulation.log import Log

DISTANCE = 45.0
#: Of each lap.
GAINS = (
    {'kp': 2.0, 'ki': 0.0, 'kd': 0.0},
    {'kp': 4.0, 'ki': 8.0, 'kd': 0.0},
    {'kp': 30.0, 'ki': 200.0, 'kd': 0.1},
)
TEXTS = ['kp 2, ki 0, kd 0', 'kp 4, ki 8, kd 0', 'kp 30, ki 200, kd 0.1']


@pytest.fixture(scope='module')
def path(module_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:  # noqa: ARG001
    """Return the bag of three laps; the gains of each are set when it begins."""
    folder = tmp_path_factory.mktemp('run')
    controllers: list[CruiseController] = []
    make, publish = CruiseController.__init__, VehicleSimulator.publish_state

    def made(self: CruiseController, **options: object) -> None:
        make(self, **options)
        controllers.append(self)

    def publish_state(self: VehicleSimulator, t: float, *rest: object) -> None:
        if t == 0.0 and self.stepper.laps:
            changed = [Parameter(name, value=v) for name, v in GAINS[self.stepper.laps].items()]
            results = controllers[0].set_parameters(changed)
            assert all(each.successful for each in results)
        publish(self, t, *rest)

    first = [word for name, value in GAINS[0].items() for word in (f'--{name}', str(value))]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(CruiseController, '__init__', made)
        patch.setattr(VehicleSimulator, 'publish_state', publish_state)
        options = ('--realtime-factor', 'max', '--distance', str(DISTANCE), '--laps', '3')
        printed('acc', '-q', *options, *first, '--bag-dir', str(folder / 'bags'))
    yield bag.newest(folder / 'bags')


@pytest.fixture(scope='module')
def laps() -> list[Log]:
    """Return the laps without ROS."""
    return [simulate(**gains, distance=DISTANCE) for gains in GAINS]


def test_each_lap_is_that_of_its_gains(path: Path, laps: list[Log]) -> None:
    log = read_bag(path)
    recorded, numbers = laps_of(log)
    settings = lap_settings_of(log, numbers)
    assert [settings.text(k) for k in range(3)] == TEXTS
    for lap, alone in zip(recorded, laps, strict=True):
        rows = np.array(numbers) == lap.number
        assert np.array_equal(log.speed[rows], alone.speed)
        for name, value in GAINS[lap.number].items():
            assert set(log.parameters[f'controller.{name}'][rows]) == {value}
        expected = summary(alone).rms_error_after_run_up
        assert lap.summary.rms_error_after_run_up == pytest.approx(expected, rel=1e-12)
    assert recorded.best
    assert recorded.best.number == 2
