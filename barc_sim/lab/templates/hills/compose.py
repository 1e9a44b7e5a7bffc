"""Four nodes in one executor, for a drive by hand: write make_nodes and main."""

import rclpy
from rclpy.executors import MultiThreadedExecutor

# Classes of nodes. Import your own class in the same way: from my_relay import MyRelay
from barc_sim.control.keyboard import Terminal
from barc_sim.nodes.keyboard import Keyboard
from barc_sim.nodes.recorder import BagRecorder
from barc_sim.nodes.relay import Relay
from barc_sim.nodes.simulator import VehicleSimulator


def make_nodes():
    """Return four nodes in a list. Only one of them publishes each topic.

    BagRecorder()         subscribes to every topic, writes bags/
    VehicleSimulator()    subscribes to ecu, publishes z_vhcl
    Relay()               subscribes to cmd_vel, publishes ecu; or a class of your own
    Keyboard(Terminal())  publishes cmd_vel; `finished` is a future; q makes it done
    """
    # TODO: make each node

    # Then replace the next line by: return [the nodes]
    raise NotImplementedError


def main():
    """Run the nodes until q or Ctrl-C."""
    rclpy.init()
    # TODO: make a MultiThreadedExecutor, add each node to it, and spin
    # TODO: at the end, call destroy_node() of each node: the recorder then finishes its bag

    # Then remove the next line.
    raise NotImplementedError


if __name__ == '__main__':
    main()
