"""Compose copies of the nodes' files, as a student does; print the states and missed commands."""

from __future__ import annotations

import rclpy
from controller import CruiseController
from rclpy.executors import MultiThreadedExecutor
from rclpy.parameter import Parameter
from relay import Relay
from simulator import VehicleSimulator

rclpy.init()
lock_step = [Parameter('realtime_factor', value=0.0), Parameter('distance', value=20.0)]
simulator = VehicleSimulator(parameter_overrides=lock_step)
executor = MultiThreadedExecutor()
for node in (CruiseController(), simulator, Relay(namespace='a')):
    executor.add_node(node)

executor.spin_until_future_complete(simulator.finished)
print(simulator.stepper.states, simulator.stepper.missed)
