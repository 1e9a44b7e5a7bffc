"""The simulator's parameters: their defaults, and a car at each of their bounds."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import barc_sim
from barc_sim.interfaces.records import Command
from barc_sim.vehicle.parameters import LIVE, PARAMETERS, PlantOptions

if TYPE_CHECKING:
    from barc_sim.vehicle.plant import Plant

PRINT_PAYLOAD = Path(__file__).with_name('programs') / 'print_payload.py'
DEFAULTS = {each.name: each.default for each in PARAMETERS}
BOUNDS = [
    (each.name, bound)
    for each in PARAMETERS
    for bound in each.between
    if isfinite(bound)
    # Lateral parameters have no part in the kinematic bicycle.
    if each.name not in ('yaw_inertia', 'front_stiffness', 'rear_stiffness', 'dynamic_above')
]


def test_defaults_are_the_labs_and_the_documented_ones() -> None:
    lab = {'mass': 2000.0, 'air_drag_coeff': 0.01308, 'friction': 0.01711, 'l_f': 1.5, 'l_r': 1.5}
    documented = {
        'gravity': 9.8,
        'rate': 50.0,
        'road': 'lab',
        'seed': 0,
        'integrator': 'euler',
        'dynamics': 'kinematic',
        'yaw_inertia': 4000.0,
        'front_stiffness': 120e3,
        'rear_stiffness': 160e3,
        'dynamic_above': 3.0,
    }
    off = {name: value for name, value in DEFAULTS.items() if name not in lab | documented}

    assert lab | documented | off == DEFAULTS
    assert set(off) == LIVE
    assert not any(off.values())


def plant(values: dict[str, Any]) -> Plant:
    return PlantOptions.of_parameters(values).plant()


@pytest.mark.parametrize(('name', 'bound'), BOUNDS)
def test_car_drives_at_each_bound(name: str, bound: float) -> None:
    car = plant(DEFAULTS | {name: bound})
    for _ in range(20):
        observation = car.observe()
        car.advance(Command(1.0, 0.1))
    assert all(map(isfinite, (*car.state, *observation.measured, *observation.surroundings)))


def test_live_parameters_change_a_car_that_drives() -> None:
    car = plant(DEFAULTS)
    PlantOptions.of_parameters(DEFAULTS | {'motor_limit': 4.0}).retune(car)
    car.advance(Command(motor=8.0))
    assert car.state.v == pytest.approx(0.08, abs=1e-4)
    assert not car.model.is_ideal
    PlantOptions.of_parameters(DEFAULTS).retune(car)
    assert car.model.is_ideal


def test_a_limit_of_0_means_no_limit() -> None:
    assert plant(DEFAULTS).waiting.motor == [0.0]
    car = plant(DEFAULTS | {'motor_delay': 0.04})
    assert not car.model.is_ideal
    car.advance(Command(motor=inf))
    assert car.state.v == 0.0


def test_a_new_parameter_of_the_car_needs_one_line(tmp_path: Path) -> None:
    without = shutil.ignore_patterns('__pycache__', 'web', 'templates')
    package = shutil.copytree(Path(barc_sim.__file__).parent, tmp_path / 'barc_sim', ignore=without)
    file = package / 'vehicle' / 'bike_model.py'
    line = "    payload: Annotated[float, 'load [kg]', 0.0, 500.0] = 0.0\n"
    text, count = re.subn(r'( +gravity: Annotated.*\n)', rf'\1{line}', file.read_text('utf-8'))
    assert count == 1
    file.write_text(text, 'utf-8')

    # Beside the copy of the package, which it imports.
    program = shutil.copy(PRINT_PAYLOAD, tmp_path)
    process = subprocess.run(
        [sys.executable, program],
        capture_output=True,
        text=True,
        check=False,
        timeout=200,
    )

    assert process.stderr == ''
    assert process.stdout.splitlines() == [
        '(0.0, 500.0) kg',
        '5.0',
        '(1500.0, 1.5)',
        '[0.16, 0.0, 0.0, 8.02]',
    ]
