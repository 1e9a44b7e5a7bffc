"""Drive the nodes on a carrier, in lock-step; print the states as JSON.

First each case is driven as its parameters say. Then it is by hand: a request is taken with the
state of its time, and one command, for which no clock is read, makes a step.
"""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

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
from barc_sim.ros.conversions import to_twist

if carrier == 'QuickExecutor':
    from barc_sim.ros.executor import QuickExecutor as Executor
elif carrier == 'local':
    from rclpy.executors import MultiThreadedExecutor as Executor
else:
    Executor = getattr(executors, carrier)

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node


#: What the driver asks for, by the number of the state.
REQUESTS = {
    0: DriverInput(forward=1.0),
    2: DriverInput(forward=1.0, turn=0.5),
    5: DriverInput(forward=0.5, turn=-0.25),
    8: DriverInput(forward=-1.0, turn=0.125),
    11: DriverInput(brake=1.0),
}


def parameters(**values: Any) -> list[rclpy.Parameter]:
    return [rclpy.Parameter(name, value=value) for name, value in values.items()]


def executor_of(*nodes: Node) -> Executor:
    executor = Executor()
    for node in nodes:
        executor.add_node(node)
    return executor


def drive_case(controller_type: str, values: dict[str, Any]) -> list[list[float]]:
    """Return the states that the sensor measures."""
    states = []
    controller = CruiseController(
        parameter_overrides=parameters(controller_type=controller_type),
    )
    simulator = VehicleSimulator(
        parameter_overrides=parameters(realtime_factor=0.0, distance=12.0, **values),
        on_step=lambda t, observation: states.append([*observation.measured]),
    )

    executor = executor_of(controller, simulator)
    executor.spin_until_future_complete(simulator.finished)

    executor.shutdown()
    controller.destroy_node()
    simulator.destroy_node()
    return states


def drive_by_hand() -> list[list[float]]:
    """Return the true states of a drive by hand."""
    states = []
    player = rclpy.create_node('player')
    twists = player.create_publisher(Twist, 'cmd_vel', 10)
    relay = Relay(driver=Driver(dt=0.1), parameter_overrides=parameters(stale_after=60.0))
    simulator = VehicleSimulator(
        parameter_overrides=parameters(realtime_factor=0.0, road='flat'),
        on_step=lambda t, observation: states.append(observation.true),
    )

    (timer,) = relay.timers
    timer.cancel()
    executor = executor_of(player, relay, simulator)

    def until(condition: Callable[[], bool]) -> None:
        while not condition():
            executor.spin_once(timeout_sec=0.1)

    until(lambda: twists.get_subscription_count() == 1)
    for k in range(15):
        until(lambda k=k: len(states) > k and relay._speed == states[k].v_x)
        if k in REQUESTS:
            twists.publish(to_twist(REQUESTS[k]))
            until(lambda k=k: relay.driver._latest == REQUESTS[k])
        timer.callback()
    return [[*state] for state in states]


rclpy.init(args=[])
cases = [drive_case(*case) for case in json.loads(sys.argv[2])]
print(json.dumps([cases, drive_by_hand()]))
