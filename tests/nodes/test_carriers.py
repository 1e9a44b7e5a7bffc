"""The nodes on every carrier and executor give the same states to the last bit."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip('rclpy')

from barc_sim.control.cruise_control import TYPES
from barc_sim.control.speed import ACCELERATION_LIMIT
from barc_sim.nodes import controller, relay, simulator
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.vehicle.parameters import PARAMETERS, PlantOptions

PROGRAMS = Path(__file__).with_name('programs')
CARRIERS = ('local', 'QuickExecutor', 'SingleThreadedExecutor', 'MultiThreadedExecutor')
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    'default': ('pid', {}),
    'noise': ('pid', {'noise_v_x': 0.05, 'noise_s': 0.1, 'seed': 3}),
    'delay': ('pid', {'motor_delay': 0.05, 'motor_lag': 0.1}),
    'sensor': ('pid', {'sensor_delay': 0.05, 'noise_v_x': 0.05}),
    'rk4': ('pid', {'integrator': 'rk4'}),
    'dynamic': ('pid', {'dynamics': 'dynamic'}),
    'lqr': ('lqr', {}),
}


def run(program: Path, *arguments: str) -> str:
    """Return what a program prints in a process of its own."""
    result = subprocess.run(
        [sys.executable, program, *arguments],
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.fixture(scope='module')
def states_by_hand() -> dict[str, list[list[float]]]:
    """Return the states by hand of the first carrier, once it has driven."""
    return {}


@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize('carrier', CARRIERS)
def test_nodes_give_the_states_of_the_closed_loop_and_by_hand_those_of_any_carrier(
    carrier: str, states_by_hand: dict[str, list[list[float]]]
) -> None:
    output = run(PROGRAMS / 'drive_cases.py', carrier, json.dumps([*CASES.values()]))
    states_of_cases, by_hand = json.loads(output)

    for (name, case), states in zip(CASES.items(), states_of_cases, strict=True):
        assert states == closed_loop_states(*case), name

    assert len(by_hand) == 15
    assert by_hand[-1][0] > 0.0
    assert by_hand == states_by_hand.setdefault('first', by_hand)


def closed_loop_states(controller_type: str, values: dict[str, Any]) -> list[list[float]]:
    """Return the measured states of a case that is driven without nodes."""
    defaults = {each.name: each.default for each in PARAMETERS}
    car = PlantOptions.of_parameters(defaults | values).plant()
    law = TYPES[controller_type]()
    law.output_min = -ACCELERATION_LIMIT
    law.output_max = ACCELERATION_LIMIT

    log = closed_loop(car, law, distance=12.0)
    columns = (log.x, log.y, log.psi, log.v_x, log.v_y, log.psi_dot)
    return [list(row) for row in zip(*columns, strict=True)]


@pytest.mark.usefixtures('ros_domain')
def test_copies_of_the_nodes_run_in_a_bare_script_on_the_stock_executor(tmp_path: Path) -> None:
    for module in (controller, relay, simulator):
        assert module.__file__
        assert 'ros.executor' not in Path(module.__file__).read_text('utf-8')
        shutil.copy(module.__file__, tmp_path)
    program = shutil.copy(PROGRAMS / 'compose_copies.py', tmp_path)

    states, missed = map(int, run(program).split())

    assert states == len(closed_loop(distance=20.0))
    assert missed == 0
