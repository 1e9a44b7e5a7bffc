"""Claim the topic of the vehicle's state until a line comes in."""

from __future__ import annotations

import rclpy
from rclpy.node import Node

from barc_sim.ros.peers import claim

rclpy.init()
node = Node('holder')
lock = claim(node, 'z_vhcl')
print('held', flush=True)
input()
