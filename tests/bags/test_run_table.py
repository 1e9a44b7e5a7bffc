"""The tables of runs that `barc convert` writes."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

import numpy as np
import pytest
from command_line import printed
from made_bags import VALUE, fill, make

from barc_sim.bags.messages import BagMessage
from barc_sim.bags.writer import BagWriter
from barc_sim.control.lane import Stanley
from barc_sim.simulation.closed_loop import closed_loop, lap

if TYPE_CHECKING:
    from pathlib import Path

    from barc_sim.simulation.log import Log


@pytest.fixture(scope='module')
def log() -> Log:
    return closed_loop(distance=2.0)


def converted(bag: Path) -> Path:
    output = bag.with_name('out')
    printed('convert', str(bag), '-o', str(output))
    return output


def columns(table: Path) -> dict[str, list[float]]:
    with table.open(encoding='utf-8', newline='') as file:
        rows = [*csv.DictReader(file)]
    return {name: [float(row[name]) for row in rows] for name in rows[0]}


def test_a_run_has_a_table_with_every_column_to_the_last_bit(tmp_path: Path, log: Log) -> None:
    found = columns(converted(make(tmp_path / 'bag', log)) / 'run.csv')
    for name, values in log.columns().items():
        np.testing.assert_array_equal(found[name], values.astype(float), err_msg=name)
    assert set(found['lap']) == {0.0}
    assert set(found['controller.kp']) == {30.0}


def test_on_a_track_the_lap_is_that_of_the_track(tmp_path: Path) -> None:
    log = lap(Stanley(), 'circle', laps=2)
    found = columns(converted(make(tmp_path / 'bag', log)) / 'run.csv')
    assert found['lap'] == log.lap.tolist()


def test_each_car_has_a_table_whatever_its_name(tmp_path: Path, log: Log) -> None:
    """A bag can be anyone's: a namespace leads to no other folder, and its characters are many."""
    (tmp_path / 'bag').mkdir()
    writer = BagWriter(tmp_path / 'bag')
    for namespace in ('/car1', '/../../up', '/a b\0c', '/' + 'é' * 300, '/é' * 200):
        fill(writer, log, namespace)
    writer.close()
    names = sorted(path.name for path in converted(tmp_path / 'bag').glob('*run*.csv'))
    assert len(names) == 5
    assert 'car1.run.csv' in names
    assert 'up.run.csv' in names or any(name.endswith('up.run.csv') for name in names)
    assert sorted(path.name for path in tmp_path.iterdir()) == ['bag', 'out']


def test_a_topic_with_the_name_of_the_runs_table_keeps_its_own(tmp_path: Path, log: Log) -> None:
    (tmp_path / 'bag').mkdir()
    writer = BagWriter(tmp_path / 'bag')
    fill(writer, log)
    topic = VALUE.__class__(**{**vars(VALUE), 'name': '/run'})
    writer.write([BagMessage(topic, bytes([0, 1, 0, 0, *bytes(8)]), 10**18, 10**18, 1)])
    writer.close()
    folder = converted(tmp_path / 'bag')
    assert [*columns(folder / 'run.csv')] == ['t', 'received', 'data']
    assert 'motor' in columns(folder / 'run_.csv')


def test_a_bag_without_a_run_gets_no_table(tmp_path: Path) -> None:
    (tmp_path / 'bag').mkdir()
    writer = BagWriter(tmp_path / 'bag')
    writer.write([BagMessage(VALUE, bytes([0, 1, 0, 0, *bytes(8)]), 1, 1, 1)])
    writer.close()
    assert [path.name for path in converted(tmp_path / 'bag').iterdir()] == ['value.csv']
