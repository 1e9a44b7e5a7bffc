"""Publish a speed as soon as anything subscribes, and end."""

from __future__ import annotations

import time

import rclpy
from rclpy.duration import Duration
from std_msgs.msg import Float64

rclpy.init()
publisher = rclpy.create_node('brief').create_publisher(Float64, 'speed_reference', 10)
print('ready', flush=True)

while not publisher.get_subscription_count():
    time.sleep(0.001)
publisher.publish(Float64(data=5.0))
publisher.wait_for_all_acked(Duration(seconds=10))
