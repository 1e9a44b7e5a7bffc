"""Relays in the manner of students: functions, and programs of ROS 1 and ROS 2."""

from __future__ import annotations

import subprocess
import sys

FUNCTION = """\
def relay(linear_x, angular_z):
    return [2.0 * linear_x, 0.3 * angular_z]
"""

CLASS = """\
class Relay:
    def __init__(self):
        self.servo = 0.0

    def relay(self, linear_x, angular_z, dt):
        wanted = 0.4 * angular_z
        self.servo += max(-dt, min(dt, wanted - self.servo))
        return [3.0 * linear_x, self.servo]
"""

#: The lab's, for ROS 1: tabs, a loop at its own rate, the topic of the stock keyboard.
ROS_1 = """\
#!/usr/bin/env python
import rospy
from barc.msg import ECU
from geometry_msgs.msg import Twist

motor = 0
servo = 0

def on_key(msg):
\tglobal motor, servo
\tmotor = 2 * msg.linear.x
\tservo = 0.3 * msg.angular.z

class RateRelay(object):
\tdef __init__(self, dt=0.05):
\t\tself.sub = rospy.Subscriber('turtle1/cmd_vel', Twist, on_key)
\t\tself.pub = rospy.Publisher('ecu', ECU, queue_size=10)
\t\tself.rate = rospy.Rate(1.0/dt)

\tdef run(self):
\t\twhile not rospy.is_shutdown():
\t\t\tself.pub.publish(ECU(motor, servo))
\t\t\tself.rate.sleep()

if __name__ == '__main__':
\trospy.init_node('teleop_relay')
\tRateRelay().run()
"""

#: Publishes in the callback alone, as simple ones do.
CALLBACK = """\
import rospy
from barc.msg import ECU
from geometry_msgs.msg import Twist

def callback(data):
    pub.publish(ECU(data.linear.x, 0.25 * data.angular.z))

rospy.init_node('relay')
pub = rospy.Publisher('/ecu', ECU, queue_size=1)
rospy.Subscriber('/cmd_vel', Twist, callback)
rospy.spin()
"""

ROS_2 = """\
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
"""

#: Keyboard and relay in one node.
COMBINED = """\
import select, sys, termios, tty
import rospy
from barc.msg import ECU

rospy.init_node('drive_by_hand')
pub = rospy.Publisher('ecu', ECU, queue_size=10)
tty.setraw(sys.stdin.fileno())
while not rospy.is_shutdown():
    pub.publish(ECU(1.0 if sys.stdin.read(1) == 'i' else 0.0, 0.0))
"""

#: Asks for full speed until the car has it.
_JOYSTICK = """
import rclpy
from barc_interfaces.msg import ZDynBkMdl
from geometry_msgs.msg import Twist, Vector3
rclpy.init()
node = rclpy.create_node('joystick')
twists = node.create_publisher(Twist, 'cmd_vel', 10)
speeds = [0.0]
node.create_subscription(ZDynBkMdl, 'z_vhcl', lambda m: speeds.append(m.v_x), 10)
node.create_timer(0.05, lambda: twists.publish(Twist(linear=Vector3(x=1.0))))
while speeds[-1] < 1.0:
    rclpy.spin_once(node)
"""


def joystick() -> None:
    """Drive, from a process of its own, until the car moves."""
    subprocess.run([sys.executable, '-c', _JOYSTICK], check=True, timeout=200)
