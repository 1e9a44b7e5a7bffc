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

#: Keyboard and relay in one node, with the keys of ROS's own keyboard node; it stops without one.
COMBINED = """\
import select, sys, termios, tty
import rospy
from barc.msg import ECU

settings = termios.tcgetattr(sys.stdin)
moves = {'i': (1.0, 0.0), ',': (-1.0, 0.0), 'j': (0.0, 0.3), 'l': (0.0, -0.3)}

def get_key():
    tty.setraw(sys.stdin.fileno())
    ready, _, _ = select.select([sys.stdin], [], [], 0.1)
    key = sys.stdin.read(1) if ready else ''
    termios.tcsetattr(sys.stdin, termios.TCSADRAIN, settings)
    return key

rospy.init_node('drive_by_hand')
pub = rospy.Publisher('ecu', ECU, queue_size=10)
try:
    while not rospy.is_shutdown():
        key = get_key()
        if key == '\\x03':
            break
        motor, servo = moves.get(key, (0.0, 0.0))
        pub.publish(ECU(motor, servo))
finally:
    termios.tcsetattr(sys.stdin, termios.TCSADRAIN, settings)
"""

#: One that adds a little at each key, waits for the next, and stops at s.
COMBINED_STEPS = """\
import sys
import termios
import tty
import rclpy
from barc_interfaces.msg import ECU

def main():
    rclpy.init()
    node = rclpy.create_node('drive')
    pub = node.create_publisher(ECU, 'ecu', 10)
    before = termios.tcgetattr(sys.stdin.fileno())
    tty.setcbreak(sys.stdin)
    motor = servo = 0.0
    while rclpy.ok():
        key = sys.stdin.read(1)
        if key == 'w':
            motor += 0.5
        elif key == 'x':
            motor -= 0.5
        elif key == 'a':
            servo += 0.05
        elif key == 'd':
            servo -= 0.05
        elif key == 's':
            motor = servo = 0.0
        pub.publish(ECU(motor=motor, servo=servo))
    termios.tcsetattr(0, termios.TCSADRAIN, before)

main()
"""

#: One that reads the arrows byte by byte, and never waits for them.
COMBINED_ARROWS = """\
import fcntl, os, sys, termios, time, tty
import rospy
from barc.msg import ECU

rospy.init_node('arrows')
pub = rospy.Publisher('ecu', ECU, queue_size=10)
old = termios.tcgetattr(0)
tty.setraw(0)
fcntl.fcntl(0, fcntl.F_SETFL, fcntl.fcntl(0, fcntl.F_GETFL) | os.O_NONBLOCK)
motor = servo = 0.0
while not rospy.is_shutdown():
    try:
        keys = os.read(0, 3)
    except OSError:
        keys = b''
    if keys == b'\\x1b[A':
        motor, servo = 2.0, 0.0
    elif keys == b'\\x1b[B':
        motor, servo = -2.0, 0.0
    elif keys == b'\\x1b[D':
        motor, servo = 0.0, 0.2
    elif keys == b'\\x1b[C':
        motor, servo = 0.0, -0.2
    elif keys:
        motor = servo = 0.0
    pub.publish(ECU(motor, servo))
    time.sleep(0.05)
"""

#: One that gets each key from the topics of the package `keyboard`.
KEY_TOPICS = """\
import rospy
from barc.msg import ECU
from keyboard.msg import Key

class Drive:
    def __init__(self):
        self.motor = self.servo = 0.0
        rospy.Subscriber('keyboard/keydown', Key, self.down)
        rospy.Subscriber('/keyboard/keyup', Key, self.up)
        self.pub = rospy.Publisher('ecu', ECU, queue_size=10)

    def down(self, key):
        if key.code == Key.KEY_UP:
            self.motor = 2.0
        elif key.code == Key.KEY_DOWN:
            self.motor = -2.0
        elif key.code in (Key.KEY_LEFT, Key.KEY_RIGHT):
            self.servo = 0.3 if key.code == Key.KEY_LEFT else -0.3

    def up(self, key):
        self.motor = self.servo = 0.0

rospy.init_node('keys')
drive = Drive()
rate = rospy.Rate(20)
while not rospy.is_shutdown():
    drive.pub.publish(ECU(drive.motor, drive.servo))
    rate.sleep()
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
    subprocess.run([sys.executable, '-c', _JOYSTICK], check=True, timeout=60.0)
