"""End while a daemon thread spins an executor."""

from __future__ import annotations

import threading

import rclpy
from rclpy.node import Node

from barc_sim.ros.executor import QuickExecutor

rclpy.init()
node = Node('tested')
ticked = threading.Event()
node.create_timer(0.001, ticked.set)
executor = QuickExecutor(2)
executor.add_node(node)
threading.Thread(target=executor.spin, daemon=True).start()
print(ticked.wait(20))
