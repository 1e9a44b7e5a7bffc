import rclpy
from barc_interfaces.msg import ECU
from geometry_msgs.msg import Twist
from rclpy.node import Node


class Relay(Node):
    def __init__(self):
        super().__init__('relay')
        self.pub = self.create_publisher(ECU, 'ecu', 10)
        self.create_subscription(Twist, 'cmd_vel', self.on_twist, 10)
        self.create_timer(0.05, self.on_timer)
        self.motor = self.servo = 0.0
        self.last = self.get_clock().now()

    def on_twist(self, twist):
        self.motor = 3.0 * twist.linear.x
        self.servo = 0.4 * twist.angular.z
        self.last = self.get_clock().now()

    def on_timer(self):
        if (self.get_clock().now() - self.last).nanoseconds > 5e8:
            self.motor = self.servo = 0.0
        self.pub.publish(ECU(motor=self.motor, servo=self.servo))


def main():
    rclpy.init()
    node = Relay()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
