import rospy
from barc.msg import ECU, Z_DynBkMdl
from geometry_msgs.msg import Twist


def on_state(z):
    pub.publish(ECU(1.0 if z.v_x < 2.0 else 0.0, 0.0))


rospy.init_node('relay')
pub = rospy.Publisher('ecu', ECU, queue_size=1)
rospy.Subscriber('z_vhcl', Z_DynBkMdl, on_state)
rospy.Subscriber('cmd_vel', Twist, print)
rospy.spin()
