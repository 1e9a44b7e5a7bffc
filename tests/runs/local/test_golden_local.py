"""Runs without ROS give the same golden figures as with it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip('rclpy')

from command_line import call
from golden.make_golden import differences, figures
from golden.scenarios import SCENARIOS
from golden.test_golden import golden

if TYPE_CHECKING:
    from pathlib import Path

    from golden.scenarios import Scenario

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
    golden: dict[str, Any], name: str, tmp_path: Path
) -> None:
    def run(scenario: Scenario, folder: Path) -> None:
        assert call(*scenario.arguments(), cwd=folder).returncode == 0

    scenario = SCENARIOS[name]
    local = scenario._replace(options=f'{scenario.options} --engine local')
    found = figures(local, tmp_path, run)
    before, engine, after = found['metadata'].partition('engine=local, without ROS ')
    assert engine
    found['metadata'] = before + after
    assert not differences(golden[name], found)
