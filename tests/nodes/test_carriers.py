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

CARRIERS = ('local', 'QuickExecutor', 'SingleThreadedExecutor', 'MultiThreadedExecutor')
#: Drives each case as its parameters say, in lock-step; then by hand: a request is taken with the
#: state of its time, and one command, for which no clock is read, makes a step.
DRIVE = """
import json, sys
carrier = sys.argv[1]
if carrier == 'local':
    from barc_sim.ros.local import install
    install()
import rclpy
from geometry_msgs.msg import Twist
from rclpy import executors
from barc_sim.control.driver import Driver, DriverInput
from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.relay import Relay
from barc_sim.nodes.simulator import VehicleSimulator
from barc_sim.ros.node_helpers import to_twist
if carrier == 'QuickExecutor':
    from barc_sim.ros.executor import QuickExecutor as Executor
else:
    Executor = getattr(executors, 'MultiThreadedExecutor' if carrier == 'local' else carrier)
def given(**values):
    return [rclpy.Parameter(name, value=value) for name, value in values.items()]
def spun(*nodes):
    executor = Executor()
    for node in nodes:
        executor.add_node(node)
    return executor
rclpy.init(args=[])
cases = []
for kind, values in json.loads(sys.argv[2]):
    cases.append([])
    nodes = [
        CruiseController(parameter_overrides=given(controller_type=kind)),
        VehicleSimulator(
            parameter_overrides=given(realtime_factor=0.0, distance=12.0, **values),
            on_step=lambda t, seen: cases[-1].append([*seen.measured]),
        ),
    ]
    executor = spun(*nodes)
    executor.spin_until_future_complete(nodes[1].finished)
    executor.shutdown()
    for node in nodes:
        node.destroy_node()
states = []
player = rclpy.create_node('player')
twists = player.create_publisher(Twist, 'cmd_vel', 10)
relay = Relay(driver=Driver(dt=0.1), parameter_overrides=given(stale_after=60.0))
(timer,) = relay.timers
timer.cancel()
simulator = VehicleSimulator(
    parameter_overrides=given(realtime_factor=0.0, road='flat'),
    on_step=lambda t, seen: states.append(seen.true),
)
executor = spun(player, relay, simulator)
def until(condition):
    while not condition():
        executor.spin_once(timeout_sec=0.1)
until(lambda: twists.get_subscription_count() == 1)
requests = {
    0: DriverInput(forward=1.0),
    2: DriverInput(forward=1.0, turn=0.5),
    5: DriverInput(forward=0.5, turn=-0.25),
    8: DriverInput(forward=-1.0, turn=0.125),
    11: DriverInput(brake=1.0),
}
for k in range(15):
    until(lambda: len(states) > k and relay._speed == states[k].v_x)
    if k in requests:
        twists.publish(to_twist(requests[k]))
        until(lambda: relay.driver._latest == requests[k])
    timer.callback()
print(json.dumps([cases, [[*state] for state in states]]))
"""
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    'default': ('pid', {}),
    'noise': ('pid', {'noise_v_x': 0.05, 'noise_s': 0.1, 'seed': 3}),
    'delay': ('pid', {'motor_delay': 0.05, 'motor_lag': 0.1}),
    'sensor': ('pid', {'sensor_delay': 0.05, 'noise_v_x': 0.05}),
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
        command, cwd=folder, capture_output=True, text=True, timeout=200, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope='module')
def by_hand() -> dict[str, list[list[float]]]:
    """Return the states by hand of the first carrier, once it has driven."""
    return {}


@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize('carrier', CARRIERS)
def test_states_are_those_of_the_closed_loop_and_by_hand_those_of_any_carrier(
    carrier: str, tmp_path: Path, by_hand: dict[str, list[list[float]]]
) -> None:
    found, hand = json.loads(run(DRIVE, carrier, json.dumps([*CASES.values()]), folder=tmp_path))
    for (case, (kind, values)), states in zip(CASES.items(), found, strict=True):
        defaults = {each.name: each.default for each in PARAMETERS}
        car = PlantOptions.of_parameters(defaults | values).plant()
        law = TYPES[kind]()
        law.output_min, law.output_max = -ACCELERATION_LIMIT, ACCELERATION_LIMIT
        log = closed_loop(car, law, distance=12.0)
        columns = (log.x, log.y, log.psi, log.v_x, log.v_y, log.psi_dot)
        assert states == [list(row) for row in zip(*columns, strict=True)], case
    assert len(hand) == 15
    assert hand[-1][0] > 0.0
    assert hand == by_hand.setdefault('states', hand)


@pytest.mark.usefixtures('ros_domain')
def test_copies_of_the_nodes_run_in_a_bare_script_on_the_stock_executor(tmp_path: Path) -> None:
    for module in (controller, relay, simulator):
        assert module.__file__
        shutil.copy(module.__file__, tmp_path)
        text = Path(module.__file__).read_text('utf-8')
        assert 'ros.executor' not in text
    states, missed = map(int, run(BARE, folder=tmp_path).split())
    assert (states, missed) == (len(closed_loop(distance=20.0)), 0)
