"""Runs give the figures of commit ee8f010 to the last bit."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip('rclpy')

from command_line import started
from golden.loops import LOOPS
from golden.make_golden import GOLDEN, differences, figures, libm, loop_figures
from golden.scenarios import SCENARIOS, Scenario

from barc_sim import read_bag, simulate

if TYPE_CHECKING:
    from pathlib import Path


#: One for each of ROS's parts; the others are slow, as their physics is that of the loops below.
QUICK = {'noise', 'user_code', 'steered_dynamic_rk4', 'teleop_user_code'}


@pytest.fixture(scope='module')
def golden() -> dict[str, Any]:
    """Return the golden figures, of every run by its name."""
    figures: dict[str, Any] = json.loads(GOLDEN.read_text(encoding='utf-8'))
    if figures.pop('libm') != libm():
        pytest.skip(
            "this machine's sines differ from those of the golden figures in the last bit: make "
            'figures of commit ee8f010 here, with golden.make_golden, to compare'
        )
    return figures


def test_every_golden_figure_belongs_to_a_run(golden: dict[str, Any]) -> None:
    assert golden.keys() == SCENARIOS.keys() | LOOPS.keys()


@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize(
    'name',
    [pytest.param(name, marks=[pytest.mark.slow] * (name not in QUICK)) for name in SCENARIOS],
)
def test_run_gives_the_golden_figures(golden: dict[str, Any], name: str, tmp_path: Path) -> None:
    folder = tmp_path / 'run'
    folder.mkdir()
    assert not differences(golden[name], figures(SCENARIOS[name], folder))


@pytest.mark.parametrize('name', LOOPS)
def test_loop_without_ros_gives_the_golden_figures(golden: dict[str, Any], name: str) -> None:
    assert not differences(golden[name], loop_figures(name))


@pytest.mark.usefixtures('ros_domain')
def test_a_run_is_that_of_simulate(tmp_path: Path) -> None:
    (tmp_path / 'speed.csv').write_text('time_s,speed_mps\n0,4\n3,8\n6,8\n6,5\n')
    parameters = {
        'vehicle_simulator:disturbance': -900.0,
        'vehicle_simulator:rate': 333.0,
        'vehicle_simulator:noise_v_x': 0.05,
        'vehicle_simulator:sensor_delay': 0.05,
    }
    options = '--realtime-factor max --distance 30 --reference speed.csv'
    with started(*Scenario(options, parameters).arguments(), cwd=tmp_path) as process:
        assert process.wait(60.0) == 0
    (bag,) = (tmp_path / 'bags').iterdir()

    assert read_bag(bag) == simulate(
        reference=tmp_path / 'speed.csv',
        disturbance=-900.0,
        noise=0.05,
        sensor_delay=0.05,
        distance=30.0,
        ts=1 / 333,
    )
