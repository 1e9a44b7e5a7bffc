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

from barc_sim.control.lane import LANE_TYPES, speed_profile
from barc_sim.control.pid import ACCELERATION_LIMIT
from barc_sim.control.types import TYPES
from barc_sim.nodes import controller, relay, simulator
from barc_sim.simulation.closed_loop import closed_loop, lap
from barc_sim.vehicle.parameters import PARAMETERS, plant
from barc_sim.vehicle.sensor import NoiseLevels
from barc_sim.vehicle.track import Track

CARRIERS = ('local', 'QuickExecutor', 'SingleThreadedExecutor', 'MultiThreadedExecutor')
#: Chooses the carrier, and spins `nodes`, of which the last is the simulator.
BEGIN = """
import json, sys
carrier = sys.argv[1]
if carrier == 'local':
    from barc_sim.ros.local import install
    install()
import rclpy
from rclpy import executors
from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.simulator import VehicleSimulator
if carrier == 'QuickExecutor':
    from barc_sim.ros.executor import QuickExecutor as Executor
else:
    Executor = getattr(executors, 'MultiThreadedExecutor' if carrier == 'local' else carrier)
def given(**values):
    return [rclpy.Parameter(name, value=value) for name, value in values.items()]
def spin(*nodes):
    executor = Executor()
    for node in nodes:
        executor.add_node(node)
    executor.spin_until_future_complete(nodes[-1].finished)
    executor.shutdown()
    for node in nodes:
        node.destroy_node()
states = []
rclpy.init(args=[])
"""
#: Drives each case as its parameters say, in lock-step.
DRIVE = f"""{BEGIN}
for law, values in json.loads(sys.argv[2]):
    states.append([])
    spin(
        CruiseController(parameter_overrides=given(**law)),
        VehicleSimulator(
            parameter_overrides=given(**{{'realtime_factor': 0.0, 'distance': 30.0}} | values),
            on_step=lambda t, seen: states[-1].append([*seen.measured, *(seen.on_track or ())]),
        ),
    )
print(json.dumps(states))
"""
#: Drives by hand: each request is published with the state of its time, one command makes a step.
BY_HAND = f"""{BEGIN}
from geometry_msgs.msg import Twist
from barc_sim.control.driver import Driver, DriverInput
from barc_sim.nodes.relay import Relay
from barc_sim.ros.node_helpers import to_twist
waiting = [
    (0.0, DriverInput(forward=1.0)),
    (0.04, DriverInput(forward=1.0, turn=0.5)),
    (0.1, DriverInput(forward=0.5, turn=-0.25)),
    (0.16, DriverInput(forward=-1.0, turn=0.125)),
    (0.22, DriverInput(brake=1.0)),
]
def on_step(t, seen):
    states.append([*seen.true])
    while waiting and waiting[0][0] <= t + 1e-9:
        twists.publish(to_twist(waiting.pop(0)[1]))
    if t >= 0.28 - 1e-9:
        simulator.stepper.end()
player = rclpy.create_node('player')
twists = player.create_publisher(Twist, 'cmd_vel', 10)
# A stall of the machine for less than `dt` changes no order.
relay = Relay(driver=Driver(dt=0.1), parameter_overrides=given(stale_after=60.0))
lock_step = given(realtime_factor=0.0, road='flat')
simulator = VehicleSimulator(parameter_overrides=lock_step, on_step=on_step)
spin(player, relay, simulator)
print(json.dumps(states))
"""
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    'default': ('pid', {}),
    'noise': ('pid', {'noise_v_x': 0.05, 'noise_s': 0.1, 'seed': 3}),
    'delay': ('pid', {'motor_delay': 0.05, 'motor_lag': 0.1}),
    'rk4': ('pid', {'integrator': 'rk4'}),
    'dynamic': ('pid', {'dynamics': 'dynamic'}),
    'lqr': ('lqr', {}),
}
#: As a student writes it; the nodes are copies of the files.
BARE = """
import rclpy
from rclpy.executors import MultiThreadedExecutor
from rclpy.parameter import Parameter
from controller import CruiseController
from relay import Relay
from simulator import VehicleSimulator
rclpy.init()
lock_step = [Parameter('realtime_factor', value=0.0), Parameter('distance', value=20.0)]
nodes = [CruiseController(), VehicleSimulator(parameter_overrides=lock_step), Relay(namespace='a')]
executor = MultiThreadedExecutor()
for node in nodes:
    executor.add_node(node)
executor.spin_until_future_complete(nodes[1].finished)
print(nodes[1].stepper.states, nodes[1].stepper.missed)
"""


def run(script: str, *arguments: str, folder: Path) -> str:
    command = [sys.executable, '-c', script, *arguments]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize('carrier', CARRIERS)
def test_states_are_those_of_the_closed_loop(carrier: str, tmp_path: Path) -> None:
    laws = [({'controller_type': kind}, values) for kind, values in CASES.values()]
    found = json.loads(run(DRIVE, carrier, json.dumps(laws), folder=tmp_path))
    for (case, (kind, values)), states in zip(CASES.items(), found, strict=True):
        car = plant({each.name: each.default for each in PARAMETERS} | values)
        law = TYPES[kind]()
        law.output_min, law.output_max = -ACCELERATION_LIMIT, ACCELERATION_LIMIT
        log = closed_loop(car, law, distance=30.0)
        columns = (log.x, log.y, log.psi, log.v_x, log.v_y, log.psi_dot)
        assert states == [list(row) for row in zip(*columns, strict=True)], case


@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize('carrier', CARRIERS)
def test_laps_are_those_of_python(carrier: str, tmp_path: Path) -> None:
    track = Track.named('figure-eight')
    logs, runs = [], []
    for name, kind in LANE_TYPES.items():
        law, gain = kind(), next(iter(kind.gains))
        setattr(law, gain, 1.2 * getattr(law, gain))
        profile = speed_profile(track, 6.0, 2.0, 1.5)
        noise = NoiseLevels(ey=0.02, epsi=0.01)
        logs.append(lap(law, track, speed=profile, laps=1, noise=noise, seed=5, dynamics='dynamic'))
        given = {'lane_type': name, f'lane.{gain}': getattr(law, gain), 'speed_reference': 6.0}
        limits = {'lateral_limit': 2.0, 'longitudinal_limit': 1.5}
        car = {'dynamics': 'dynamic', 'noise_ey': 0.02, 'noise_epsi': 0.01, 'seed': 5}
        runs.append(({'track': track.name, **given, **limits}, {'track': track.name, **car}))
    found = json.loads(
        run(DRIVE.replace('30.0', '0.0'), carrier, json.dumps(runs), folder=tmp_path)
    )
    for log, states in zip(logs, found, strict=True):
        measured = log.x, log.y, log.psi, log.v_x, log.v_y, log.psi_dot
        columns = *measured, log.s, log.e_y, log.e_psi, log.curvature, log.lap, log.lap_time
        assert states == [list(row) for row in zip(*columns, strict=True)]


@pytest.mark.usefixtures('ros_domain')
def test_recorded_requests_drive_the_same_way(tmp_path: Path) -> None:
    found = [json.loads(run(BY_HAND, carrier, folder=tmp_path)) for carrier in CARRIERS]
    assert found[0][-1][0] > 0.0
    assert len(found[0]) == 15
    assert [states == found[0] for states in found] == [True] * len(CARRIERS)


@pytest.mark.usefixtures('ros_domain')
def test_copies_of_the_nodes_run_in_a_bare_script_on_the_stock_executor(tmp_path: Path) -> None:
    for module in (controller, relay, simulator):
        assert module.__file__
        shutil.copy(module.__file__, tmp_path)
        text = Path(module.__file__).read_text('utf-8')
        assert 'ros.executor' not in text
    states, missed = map(int, run(BARE, folder=tmp_path).split())
    assert (states, missed) == (len(closed_loop(distance=20.0)), 0)
