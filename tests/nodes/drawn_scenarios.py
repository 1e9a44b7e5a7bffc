"""Drives nodes through scenarios in lock-step, and prints the states of each as JSON.

The argument is the carrier, `local` or `dds`. The standard input has the scenarios: for each the
parameters of the node `vehicle_simulator`, and those of the node `controller`.
"""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

if sys.argv[1] == 'local':
    from barc_sim.ros.local import install

    install()

import rclpy
from rclpy.executors import SingleThreadedExecutor

from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.simulator import VehicleSimulator

if TYPE_CHECKING:
    from collections.abc import Mapping

    from barc_sim.vehicle.plant import Observation


def parameters(values: Mapping[str, Any]) -> list[rclpy.Parameter]:
    """Return values as parameters."""
    return [rclpy.Parameter(name, value=value) for name, value in values.items()]


def drive(of_simulator: Mapping[str, Any], of_controller: Mapping[str, Any]) -> list[list[float]]:
    """Return what the sensor measured in each state of a run."""
    states: list[list[float]] = []

    def store(_: float, observation: Observation) -> None:
        states.append([*observation.measured])

    controller = CruiseController(parameter_overrides=parameters(of_controller))
    simulator = VehicleSimulator(parameter_overrides=parameters(of_simulator), on_step=store)
    executor = SingleThreadedExecutor()
    for node in (controller, simulator):
        executor.add_node(node)
    executor.spin_until_future_complete(simulator.finished)
    executor.shutdown()
    for node in (controller, simulator):
        node.destroy_node()
    return states


if __name__ == '__main__':
    rclpy.init(args=[])
    json.dump([drive(*each) for each in json.load(sys.stdin)], sys.stdout)
