"""Publish a message and destroy the publisher; print what arrives, and files that are shared."""

from __future__ import annotations

import os
from pathlib import Path

from barc_sim.ros.process import use_profiles

use_profiles(os.environ)
import rclpy
from std_msgs.msg import Float64

rclpy.init()
node = rclpy.create_node('node')
received: list[Float64] = []
subscription = node.create_subscription(Float64, 'topic', received.append, 10)
publisher = node.create_publisher(Float64, 'topic', 10)
while not publisher.get_subscription_count():
    rclpy.spin_once(node, timeout_sec=0.01)
publisher.publish(Float64(data=5.0))
node.destroy_publisher(publisher)
for _ in range(200):
    rclpy.spin_once(node, timeout_sec=0.01)
    if received:
        break

process = f'.{os.getpid() & 255:02x}.{os.getpid() >> 8 & 255:02x}.'
names = [path.name for path in Path('/dev/shm').iterdir()]  # noqa: S108 (where Fast DDS has it)
shared = [name for name in names if 'datasharing' in name and process in name]
print(received, shared)
rclpy.shutdown()
