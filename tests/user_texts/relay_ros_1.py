#!/usr/bin/env python
import rospy
from barc.msg import ECU
from geometry_msgs.msg import Twist

motor = 0
servo = 0

def on_key(msg):
	global motor, servo
	motor = 2 * msg.linear.x
	servo = 0.3 * msg.angular.z

class RateRelay(object):
	def __init__(self, dt=0.05):
		self.sub = rospy.Subscriber('turtle1/cmd_vel', Twist, on_key)
		self.pub = rospy.Publisher('ecu', ECU, queue_size=10)
		self.rate = rospy.Rate(1.0/dt)

	def run(self):
		while not rospy.is_shutdown():
			self.pub.publish(ECU(motor, servo))
			self.rate.sleep()

if __name__ == '__main__':
	rospy.init_node('teleop_relay')
	RateRelay().run()
