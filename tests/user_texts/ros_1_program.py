#!/usr/bin/env python
import rospy
from barc.msg import ECU, Z_DynBkMdl
from labs.msg import *
from std_msgs.msg import Float64
from .bike_model import bikeFE
from . import input_map
import matplotlib.pyplot as plt
from math import sin

rospy.init_node('x')

def clock():
    return rospy.get_time() - 1.0

class PID(rospy.SubscribeListener):
    pass

def main():
    while not rospy.is_shutdown():
        rospy.sleep(1.0)

try:
    main()
except rospy.ROSInterruptException:
    pass
