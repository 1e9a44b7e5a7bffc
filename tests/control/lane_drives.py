"""Prints errors, as JSON, of drives with the lane law in the node, in `lap` and in the lab's judge.

With the argument `turned`, the law has one wrong sign. The node runs over `ros/local`.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from barc_sim.ros.local import install

install()

import rclpy
from rclpy.executors import SingleThreadedExecutor

from barc_sim import lap
from barc_sim.control import lane
from barc_sim.lab.labs import lane as judge
from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.simulator import VehicleSimulator

law = lane.lane_lqr


def turned(*arguments: Any) -> Any:  # noqa: ANN401 (as the law's)
    """Return the terms of the law with the wrong sign of one of them."""
    terms = law(*arguments)
    return terms._replace(of_e_y=-terms.of_e_y)


def overrides(**values: object) -> list[Any]:
    """Return parameters."""
    return [rclpy.Parameter(name, value=value) for name, value in values.items()]


def node_errors() -> list[float]:
    """Return e_y [m] of each state of a lap with the nodes, until the car is far off the line."""
    rclpy.init(args=[])
    errors: list[float] = []
    controller = CruiseController(parameter_overrides=overrides(track='oval', speed_reference=6.0))
    simulator = VehicleSimulator(
        parameter_overrides=overrides(track='oval', realtime_factor=0.0, laps=1),
        on_step=lambda _, observation: errors.append(observation.on_track.e_y),
    )
    executor = SingleThreadedExecutor()
    executor.add_node(controller)
    executor.add_node(simulator)
    while not simulator.finished.done() and (not errors or abs(errors[-1]) < 3.0):
        executor.spin_once()
    return errors


if sys.argv[1] == 'turned':
    lane.lane_lqr = turned
errors = node_errors()
log = lap(track='oval', speed=6.0, laps=1)
judged = judge._drive(lambda _: lane.LaneLQR(), judge._STRAIGHT, judge._COURSE, judge._OFFSET)
count = min(len(errors), len(log))
print(
    json.dumps(
        {
            'node': max(map(abs, errors)),
            'lap': float(abs(log.e_y).max()),
            'judge': float(abs(judged.e_y[-1])),
            'same': errors[:count] == log.e_y[:count].tolist(),
        }
    )
)
