"""Put the car elsewhere, as RViz does, and end when it has driven 15 m from there."""

from __future__ import annotations

import rclpy
from barc_interfaces.msg import ZDynBkMdl
from geometry_msgs.msg import PoseWithCovarianceStamped

rclpy.init()
node = rclpy.create_node('rviz')
publisher = node.create_publisher(PoseWithCovarianceStamped, 'initialpose', 1)
places: list[float] = []
node.create_subscription(ZDynBkMdl, 'z_vhcl', lambda state: places.append(state.x), 100)
print('ready', flush=True)

while len(places) < 10 or not publisher.get_subscription_count():
    rclpy.spin_once(node)

pose = PoseWithCovarianceStamped()
pose.header.frame_id = 'map'
pose.pose.pose.position.x = -40.0
pose.pose.pose.position.y = 3.0
publisher.publish(pose)

while places[-1] > -35.0:
    rclpy.spin_once(node)
while places[-1] < -25.0:
    rclpy.spin_once(node)
