"""Runs without ROS give the same golden figures as with it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip('rclpy')

from golden.make_golden import differences, figures
from golden.scenarios import SCENARIOS
from golden.test_golden import golden

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ['golden']

#: Those that need no node of another process and no namespace.
NAMES = [
    name
    for name, scenario in SCENARIOS.items()
    if scenario.mode == 'acc'
    and not (scenario.driver or scenario.remap or '--cars' in scenario.options)
]


@pytest.mark.parametrize('name', NAMES)
def test_run_without_ros_gives_the_golden_figures(
    golden: dict[str, Any],
    name: str,
    tmp_path: Path,
) -> None:
    scenario = SCENARIOS[name]
    folder = tmp_path / 'run'
    folder.mkdir()
    found = figures(scenario._replace(options=f'{scenario.options} --engine local'), folder)
    assert found['metadata'].pop('engine') == 'local, without ROS'
    assert not differences(golden[name], found)
