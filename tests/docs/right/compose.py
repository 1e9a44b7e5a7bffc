"""A right answer to the lab's third task: four nodes in one executor."""

import rclpy
from rclpy.executors import MultiThreadedExecutor

from barc_sim.control.keyboard import Terminal
from barc_sim.nodes.keyboard import Keyboard
from barc_sim.nodes.recorder import BagRecorder
from barc_sim.nodes.relay import Relay
from barc_sim.nodes.simulator import VehicleSimulator


def make_nodes():
    """Return four nodes in a list."""
    return [BagRecorder(), VehicleSimulator(), Relay(), Keyboard(Terminal())]


def main():
    """Run the nodes until q or Ctrl-C."""
    rclpy.init()
    nodes = make_nodes()
    *_, keyboard = nodes
    executor = MultiThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    executor.spin_until_future_complete(keyboard.finished)
    for node in nodes:
        node.destroy_node()


if __name__ == '__main__':
    main()
