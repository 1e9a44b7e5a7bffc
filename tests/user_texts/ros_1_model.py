#!/usr/bin/env python
from numpy import sin, cos, tan, arctan, array, dot
from numpy import sign, sqrt
import rospy

def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):
	l_f = 1.5
        l_r = 1.5
	g = 9.8
	beta = arctan(l_r/(l_f+l_r)*tan(d_f))
	x_next = x + ts*v*cos(psi+beta)
	y_next = y + ts*v*sin(psi+beta)
	psi_next = psi + ts*v/l_r*sin(beta)
	F_ext = -m*g*sin(theta) - a0*v**2 - Ff
	v_next = v + ts*(a + F_ext/m)
	return array([x_next, y_next, psi_next, v_next])
