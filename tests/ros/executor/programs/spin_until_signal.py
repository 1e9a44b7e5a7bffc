"""Spin an executor until a signal ends it."""

from __future__ import annotations

from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import Bool

from barc_sim.ros.executor import QuickExecutor

rclpy.init()
node = Node('tested')
publisher = node.create_publisher(Bool, 'answer', 1)


def on_timer() -> None:
    publisher.publish(Bool())  # raises once the context has ended
    print('spinning', flush=True)


node.create_timer(0.01, on_timer)
with QuickExecutor(2) as executor:
    executor.add_node(node)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()
node.destroy_node()
rclpy.try_shutdown()
print('ended')
