"""A controller that anybody could write."""

from __future__ import annotations

import rclpy
from barc_interfaces.msg import ECU, ZDynBkMdl
from rclpy.node import Node


class ProportionalController(Node):
    """Commands an acceleration in proportion to the error of the speed."""

    def __init__(self) -> None:
        super().__init__('proportional_controller')
        self.commands = self.create_publisher(ECU, 'ecu', 10)
        self.create_subscription(ZDynBkMdl, 'z_vhcl', self.on_state, 10)

    def on_state(self, state: ZDynBkMdl) -> None:
        """Answer a state."""
        self.commands.publish(ECU(header=state.header, motor=8.0 - state.v_x))


rclpy.init()
rclpy.spin(ProportionalController())
