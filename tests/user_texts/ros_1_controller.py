#!/usr/bin/env python
import rospy
import time
from barc.msg import ECU, Z_DynBkMdl
from numpy import pi

v_x = 0

def measurements_callback(data):
    global v_x
    v_x = data.v_x

class PID():
    def __init__(self, kp=1, ki=1, kd=1):
        self.kp = kp
        self.ki = ki
        self.kd = kd
        self.int_error = 0
        self.previous = 0

    def acc_calculate(self, speed_reference, speed_current):
        error = speed_reference - speed_current
        # integral
        self.int_error = self.int_error + error
        I = self.ki * self.int_error
        # derivative
        D = self.kd * (error - self.previous)
        self.previous = error
        acc = self.kp * error + I + D
        return acc

def controller():
    rospy.init_node('controller', anonymous=True)
    rospy.Subscriber('z_vhcl', Z_DynBkMdl, measurements_callback)
    acc_pub = rospy.Publisher('ecu', ECU, queue_size=10)
    rate = rospy.Rate(50)
    # tuned by hand
    PID_control = PID(kp=10, ki=0.5, kd=0.4)
    while not rospy.is_shutdown():
        acc = PID_control.acc_calculate(8, v_x)
        acc_pub.publish(ECU(acc, 0))
        rate.sleep()

if __name__ == '__main__':
    try:
        controller()
    except rospy.ROSInterruptException:
        pass
