import select, sys, termios, tty
import rospy
from barc.msg import ECU

rospy.init_node('drive_by_hand')
pub = rospy.Publisher('ecu', ECU, queue_size=10)
tty.setraw(sys.stdin.fileno())
while not rospy.is_shutdown():
    pub.publish(ECU(1.0 if sys.stdin.read(1) == 'i' else 0.0, 0.0))
