"""Gains that change during a run are shown for the lap that had them, the same everywhere."""

from __future__ import annotations

import csv
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip('rclpy')

from command_line import printed
from matplotlib.figure import Figure
from matplotlib.table import Table
from matplotlib.text import Text
from rclpy.parameter import Parameter

from barc_sim import read_bag
from barc_sim.bags import reader as bag
from barc_sim.figures.run_figures import run_figure
from barc_sim.figures.views import SideView
from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.simulator import VehicleSimulator
from barc_sim.simulation.closed_loop import simulate
from barc_sim.simulation.metrics import lap_settings_of, laps_of, summary

if TYPE_CHECKING:
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
def path(module_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Path:  # noqa: ARG001
    """Return the bag of three laps; the gains of each are set when it begins."""
    folder = tmp_path_factory.mktemp('run')
    controllers: list[CruiseController] = []
    make, publish = CruiseController.__init__, VehicleSimulator.publish_state

    def make_controller(self: CruiseController, **options: object) -> None:
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
        patch.setattr(CruiseController, '__init__', make_controller)
        patch.setattr(VehicleSimulator, 'publish_state', publish_state)
        options = ('--realtime-factor', 'max', '--distance', str(DISTANCE), '--laps', '3')
        printed('acc', '-q', *options, *first, '--bag-dir', str(folder / 'bags'))
    return bag.newest(folder / 'bags')


@pytest.fixture(scope='module')
def laps() -> list[Log]:
    """Return the laps without ROS."""
    return [simulate(**gains, distance=DISTANCE) for gains in GAINS]


def test_each_lap_is_driven_with_the_gains_of_its_time(path: Path, laps: list[Log]) -> None:
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


@pytest.fixture(scope='module')
def errors(laps: list[Log]) -> list[float]:
    """Return the RMS error of each lap [m/s], after the run-up."""
    return [summary(each).rms_error_after_run_up for each in laps]


def test_the_plot_has_the_errors_and_the_gains_of_each_lap(path: Path, errors: list[float]) -> None:
    figure = run_figure(read_bag(path), bag.info(path), '', None)
    (table,) = figure.findobj(Table)
    texts = {place: cell.get_text().get_text() for place, cell in table.get_celld().items()}
    for k in range(3):
        assert texts[k + 1, 0] == f'{k + 1}'
        assert texts[k + 1, 2] == f'{errors[k]:.3f} m/s'
        assert texts[k + 1, 6] == TEXTS[k]

    names = [str(line.get_label()) for line in figure.axes[0].lines]
    assert names == ['other laps', 'lap 3, best and last', 'reference']

    heading = {text.get_text() for text in figure.axes[0].texts}
    assert 'road lab · kp 2 → 4 → 30 · ki 0 → 8 → 200 · kd 0 → 0.1' in heading


def test_the_report_has_the_errors_and_the_gains_of_each_lap(
    path: Path, errors: list[float], tmp_path: Path
) -> None:
    printed('report', str(path), '-o', str(tmp_path / 'report.html'))
    page = (tmp_path / 'report.html').read_text(encoding='utf-8')
    for k in range(3):
        row = re.search(rf'>lap {k + 1}, .*?</tr>', page)
        assert row
        assert f'<td>{errors[k]:.4f}</td>' in row[0]
        assert f'<td>{TEXTS[k]}</td>' in row[0]

    assert '<td><span>2 → 4 → 30</span></td>' in page
    assert 'The controller&#39;s terms in lap 3' in page
    for name in ('kp', 'ki'):
        assert page.count(f'<th scope="row">controller.{name}</th>') == 2


def test_the_table_has_the_gains_of_each_state(
    path: Path, errors: list[float], tmp_path: Path
) -> None:
    printed('convert', str(path), '-o', str(tmp_path / 'out'))
    with (tmp_path / 'out' / 'run.csv').open(encoding='utf-8', newline='') as file:
        rows = [*csv.DictReader(file)]
    log = read_bag(path)
    assert len(rows) == len(log)

    for k in range(3):
        lap = [row for row in rows if row['lap'] == f'{k}']
        for name, value in GAINS[k].items():
            assert {float(row[f'controller.{name}']) for row in lap} == {value}
        speeds = [float(row['reference']) - float(row['v_x']) + float(row['e_v_x']) for row in lap]
        after = [e for e, row in zip(speeds, lap, strict=True) if float(row['x']) >= 10.0]
        assert np.sqrt(np.mean(np.square(after))) == pytest.approx(errors[k], rel=1e-9)
    assert [float(row['motor']) for row in rows] == log.motor.tolist()


def test_a_chosen_topic_is_converted_alone(path: Path, tmp_path: Path) -> None:
    printed('convert', str(path), '-o', str(tmp_path / 'out'), '--topics', '/ecu')
    assert [each.name for each in (tmp_path / 'out').iterdir()] == ['ecu.csv']


def test_the_video_has_the_gains_of_the_lap_that_it_shows(path: Path) -> None:
    log = read_bag(path)
    numbers = laps_of(log)[1]
    view = SideView(log, Figure(figsize=(12.8, 7.2)))
    for k in range(3):
        first = numbers.index(k)
        view.update(float(log.t[first + 10]))
        texts = {each.get_text() for each in view.artists if isinstance(each, Text)}
        assert f'lap {k + 1}: {TEXTS[k]}' in texts
