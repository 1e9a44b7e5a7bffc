
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
