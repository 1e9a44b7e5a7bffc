import rospy
from barc.msg import ECU
from geometry_msgs.msg import Twist

def callback(data):
    pub.publish(ECU(data.linear.x, 0.25 * data.angular.z))

rospy.init_node('relay')
pub = rospy.Publisher('/ecu', ECU, queue_size=1)
rospy.Subscriber('/cmd_vel', Twist, callback)
rospy.spin()
