"""The law of the lane stands in one place: a changed sign is seen wherever the law drives."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

#: Drives in the node over `ros/local`, in `lap`, and as the lab's judge drives its own law.
DRIVES = """
import json, sys
from barc_sim.ros.local import install
install()
import rclpy
from rclpy.executors import SingleThreadedExecutor
from barc_sim import lap
from barc_sim.control import lane
from barc_sim.lab.labs import lane as judge
from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.simulator import VehicleSimulator
from barc_sim.vehicle.track import Track

def turned(*arguments):
    terms = law(*arguments)
    return terms._replace(of_e_y=-terms.of_e_y)

law = lane.lane_lqr
if sys.argv[1] == 'turned':
    lane.lane_lqr = turned

rclpy.init(args=[])
rows = []
def given(**values):
    return [rclpy.Parameter(name, value=value) for name, value in values.items()]
controller = CruiseController(parameter_overrides=given(track='oval', speed_reference=6.0))
simulator = VehicleSimulator(
    parameter_overrides=given(track='oval', realtime_factor=0.0, laps=1),
    on_step=lambda t, seen: rows.append(seen.on_track.e_y),
)
executor = SingleThreadedExecutor()
executor.add_node(controller)
executor.add_node(simulator)
while not simulator.finished.done() and (not rows or abs(rows[-1]) < 3.0):
    executor.spin_once()

log = lap(track='oval', speed=6.0, laps=1)
judged = judge._drive(lambda plant: lane.LaneLQR(), judge._STRAIGHT, judge._COURSE, judge._OFFSET)
shared = min(len(rows), len(log))
print(json.dumps({
    'node': max(map(abs, rows)),
    'lap': float(abs(log.e_y).max()),
    'judge': float(abs(judged.e_y[-1])),
    'same': rows[:shared] == log.e_y[:shared].tolist(),
}))
"""


def drives(sign: str, folder: Any) -> dict[str, float]:  # noqa: ANN401 (a path)
    done = subprocess.run(
        [sys.executable, '-c', DRIVES, sign],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, float] = json.loads(done.stdout)
    return found


def test_a_changed_sign_of_a_lane_law_is_seen_by_node_run_and_judge(tmp_path: Any) -> None:  # noqa: ANN401
    right, turned = (drives(sign, tmp_path) for sign in ('right', 'turned'))
    assert right['same']
    assert turned['same']
    for where in ('node', 'lap', 'judge'):
        assert right[where] < 0.3, where
        assert turned[where] > 2.9, where
