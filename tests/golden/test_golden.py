"""Runs give the figures of commit ee8f010 to the last bit."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip('rclpy')

from golden.loops import LOOPS
from golden.make_golden import GOLDEN, differences, figures, libm, loop_figures
from golden.scenarios import SCENARIOS

if TYPE_CHECKING:
    from pathlib import Path


#: One for each of ROS's parts; the others are slow, as their physics is that of the loops below.
QUICK = {'noise', 'ten_cars', 'user_code', 'steered_dynamic_rk4', 'teleop_user_code'}


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
