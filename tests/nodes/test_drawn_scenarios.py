"""Nodes, `simulate` and a batch of environments give the same states to the last bit."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import gymnasium
import numpy as np
import pytest

pytest.importorskip('rclpy')

import barc_sim.learning  # noqa: F401 (registers the environments)
from barc_sim.control.cruise_control import LANE_TYPES, TYPES
from barc_sim.control.lane import LANE
from barc_sim.learning.options import OPTIONS
from barc_sim.simulation.closed_loop import simulate
from barc_sim.simulation.log import TrackLog
from barc_sim.simulation.scenario import Scenario
from barc_sim.simulation.stepper import parameters

if TYPE_CHECKING:
    from barc_sim.simulation.log import Log

PROGRAM = Path(__file__).with_name('drawn_scenarios.py')
DISTANCE = 7.0
GAINS = {'kp': (2.0, 60.0), 'ki': (0.0, 250.0), 'kd': (0.0, 0.5), 'observer_gain': (0.0, 1.0)}
LANE_GAINS = {
    'lqr': {'q_e_y': (0.01, 0.5), 'q_e_psi': (0.0, 2.0), 'preview': (0.0, 0.2)},
    'stanley': {'k': (0.5, 5.0), 'v_soft': (0.5, 3.0)},
    'pure-pursuit': {'look_ahead': (1.0, 5.0), 'look_ahead_time': (0.0, 0.4)},
}


class Drawn(NamedTuple):
    """A scenario, as parameters of the nodes."""

    simulator: dict[str, Any]
    controller: dict[str, Any]

    @property
    def scenario(self) -> Scenario:
        """The record of the run."""
        of_run = self.controller
        on_track = bool(self.simulator.get('track'))
        defaults = {row.name: row.default for row in parameters(on_track=on_track)}
        law = TYPES[of_run['controller_type']]()
        for name in law.gains.keys() & of_run.keys():
            setattr(law, name, of_run[name])
        options: dict[str, Any] = {'controller': law}
        if on_track:
            lane: Any = LANE_TYPES[of_run['lane_type']]()
            for name in lane.gains.keys() & {each.removeprefix(LANE) for each in of_run}:
                setattr(lane, name, of_run[LANE + name])
            options |= {'lane': lane, 'track': self.simulator['track']}
        values = {**defaults, **self.simulator}
        values.pop('laps')
        return Scenario.of_parameters(values, speed_reference=of_run['speed_reference'], **options)


def draw(number: int) -> Drawn:
    """Draw a scenario: course, car, actuators, sensor, and laws with their gains."""
    random = np.random.default_rng(number)

    def sometimes(share: float, low: float, high: float) -> float:
        return float(random.uniform(low, high)) if random.random() < share else 0.0

    simulator: dict[str, Any] = {
        'realtime_factor': 0.0,
        'distance': DISTANCE,
        'rate': float(random.choice([50.0, 80.0, 100.0])),
        'seed': int(random.integers(0, 2**40)),
        'integrator': str(random.choice(['euler', 'rk4'])),
        'dynamics': str(random.choice(['kinematic', 'dynamic'])),
        'dynamic_above': 3.0,
        'mass': float(random.uniform(1000.0, 2500.0)),
        'air_drag_coeff': sometimes(0.7, 0.0, 3.0),
        'friction': sometimes(0.7, 0.0, 300.0),
        'l_f': float(random.uniform(1.0, 2.0)),
        'l_r': float(random.uniform(1.0, 2.0)),
        'disturbance': sometimes(0.3, -300.0, 300.0),
        'motor_delay': sometimes(0.6, 0.0, 0.1),
        'motor_lag': sometimes(0.4, 0.02, 0.3),
        'motor_limit': sometimes(0.3, 3.0, 8.0),
        'sensor_delay': sometimes(0.3, 0.0, 0.1),
    }
    controller: dict[str, Any] = {
        'controller_type': str(random.choice(['pid', 'lqr'])),
        'speed_reference': float(random.uniform(2.0, 6.0)),
    }
    kind = TYPES[controller['controller_type']]
    for name in kind.gains.keys() & GAINS.keys():
        controller[name] = float(random.uniform(*GAINS[name]))

    noise = 0.05 * (random.random() < 0.5)
    simulator |= {'noise_v_x': noise, 'noise_s': noise}
    if random.random() < 0.5:
        simulator['road'] = str(random.choice(['lab', 'flat']))
        return Drawn(simulator, controller)

    track = str(random.choice(['L', 'oval', 'circle', 'figure-eight']))
    simulator |= {'track': track, 'laps': 1, 'noise_ey': 0.2 * noise, 'noise_epsi': 0.2 * noise}
    simulator |= {'servo_delay': sometimes(0.6, 0.0, 0.1), 'servo_lag': sometimes(0.7, 0.02, 0.3)}
    simulator['servo_rate_limit'] = sometimes(0.5, 0.5, 2.0)
    lane = str(random.choice([*LANE_GAINS]))
    controller |= {'track': track, 'lane_type': lane}
    for name, limits in LANE_GAINS[lane].items():
        controller[LANE + name] = float(random.uniform(*limits))
    return Drawn(simulator, controller)


def states_of(log: Log) -> list[list[float]]:
    columns = log.x, log.y, log.psi, log.v_x, log.v_y, log.psi_dot
    return [list(row) for row in zip(*columns, strict=True)]


def by_nodes(carrier: str, scenarios: list[Drawn], folder: Path) -> list[list[list[float]]]:
    """Return the states of all runs, of nodes on a carrier."""
    process = subprocess.run(
        [sys.executable, str(PROGRAM), carrier],
        input=json.dumps(scenarios),
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60.0 + 5.0 * len(scenarios),
        check=False,
    )
    assert process.returncode == 0, process.stderr
    states_of_scenarios: list[list[list[float]]] = json.loads(process.stdout)
    return states_of_scenarios


def by_batch(sample: Drawn, log: Log) -> list[list[float]]:
    """Return s, e_y and the measured speed of the second of two cars with the commands of a run."""
    scenario = sample.scenario
    options = {name: getattr(scenario, name) for name in OPTIONS}
    actions = log.motor[:, np.newaxis] / 8.0
    start = {'s': 0.0, 'v': 0.0}
    task = 'Hills'
    if scenario.track:
        task = 'Race'
        actions = np.column_stack([actions, log.servo / 0.5])
        start |= {'e_y': 0.0, 'e_psi': 0.0}
    else:
        del options['track']
    env = gymnasium.make_vec(
        f'barc_sim/{task}-v0', 2, vectorization_mode='vector_entry_point', **options
    )
    speed = 2 if scenario.track else 1  # the column of the observation

    observations, info = env.reset(seed=[0, scenario.seed], options=start)
    rows = [[*place_of(info), float(observations[1, speed])]]
    for action in actions[:-1]:
        observations, *_, info = env.step(np.tile(action, (2, 1)))
        rows.append([*place_of(info), float(observations[1, speed])])
    env.close()
    return rows


def place_of(info: dict[str, Any]) -> tuple[float, float]:
    """Return s and e_y of the second car; on a road e_y is 0."""
    across = info.get('e_y', np.zeros(2))
    return float(info['s'][1]), float(across[1])


@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize(
    'numbers', [range(12), pytest.param(range(12, 200), marks=pytest.mark.slow)], ids=len
)
def test_all_parts_give_the_same_states_to_the_last_bit(numbers: range, tmp_path: Path) -> None:
    scenarios = [draw(number) for number in numbers]
    logs = [simulate(scenario=each.scenario) for each in scenarios]
    expected = [states_of(log) for log in logs]
    assert sum(len(states) for states in expected) > 100 * len(numbers)
    for carrier in ('local', 'dds'):
        of_nodes = by_nodes(carrier, scenarios, tmp_path)
        for number, states, other in zip(numbers, expected, of_nodes, strict=True):
            assert other == states, (carrier, number, scenarios[number - numbers.start])


@pytest.mark.parametrize(
    'numbers', [range(300, 330), pytest.param(range(330, 600), marks=pytest.mark.slow)], ids=len
)
def test_a_batch_gives_the_states_and_measurements_of_a_run_to_the_last_bit(numbers: range) -> None:
    for each in map(draw, numbers):
        log = simulate(scenario=each.scenario)
        rows = by_batch(each, log)
        assert [speed for *_, speed in rows] == log.v_x.tolist(), each
        if isinstance(log, TrackLog):
            assert [row[:2] for row in rows] == np.column_stack([log.s, log.e_y]).tolist(), each
        elif not (any(log.e_s) or each.scenario.sensor_delay):
            assert [s for s, *_ in rows] == log.x.tolist(), each
