"""Laps: the road begins anew, and each lap has its row in what reads the run."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import pytest
import yaml
from command_line import barc

from barc_sim.bags import reader
from barc_sim.simulation.metrics import laps_of

if TYPE_CHECKING:
    from pathlib import Path

    from barc_sim.simulation.log import Log

ROW = re.compile(r' +(\d+)  +0\.0 to +(\d+\.\d) m +0\.\d+ +0\.\d+ +0\.3% +1\.00')


def drive(folder: Path, *options: str) -> tuple[str, Path]:
    """Drive in lock-step; return what the run prints, and its bag."""
    words = ('--realtime-factor', 'max', '--distance', '30')
    done = barc('acc', *words, '--bag-dir', str(folder), *options)
    assert done.returncode == 0, done.stderr
    return done.stdout, next(folder.iterdir())


def lap_of(log: Log, number: int) -> dict[str, np.ndarray]:  # type: ignore[type-arg]
    """Return the columns of a lap, but for the time."""
    rows = np.array(laps_of(log)[1]) == number
    columns = log.map(lambda values: values[rows]).columns()
    return {name: values for name, values in columns.items() if name != 't'}


@pytest.mark.usefixtures('ros_domain')
def test_each_lap_is_the_run_of_one_lap_to_the_last_bit(tmp_path: Path) -> None:
    _, single = drive(tmp_path / 'single')
    out, several = drive(tmp_path / 'several', '--laps', '2')
    assert [ROW.match(line).groups() for line in out.splitlines() if ROW.match(line)] == [  # type: ignore[union-attr]
        ('1', '30.2'),
        ('2', '30.2'),
    ]
    expected = lap_of(reader.read(single), 0)
    log = reader.read(several)
    for number in range(2):
        lap = lap_of(log, number)
        for name, values in expected.items():
            assert lap[name].tobytes() == values.tobytes(), name
    parameters = yaml.safe_load(reader.info(several)['parameters'])
    assert parameters['/vehicle_simulator']['ros__parameters']['laps'] == 2
    barc('report', str(several), '-o', str(tmp_path / 'report.html'))
    assert 'lap 2, 0.0 to 30.2 m' in (tmp_path / 'report.html').read_text()
