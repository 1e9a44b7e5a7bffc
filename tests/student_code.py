"""Submissions in the manner of students, made from one ROS 1 script."""

from __future__ import annotations

from typing import NamedTuple

from user_files import replaced

MODEL = """\
#!/usr/bin/env python
from numpy import sin, cos, tan, arctan, array, dot
from numpy import sign, sqrt
import rospy

def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):
\tl_f = 1.5
        l_r = 1.5
\tg = 9.8
\tbeta = arctan(l_r/(l_f+l_r)*tan(d_f))
\tx_next = x + ts*v*cos(psi+beta)
\ty_next = y + ts*v*sin(psi+beta)
\tpsi_next = psi + ts*v/l_r*sin(beta)
\tF_ext = -m*g*sin(theta) - a0*v**2 - Ff
\tv_next = v + ts*(a + F_ext/m)
\treturn array([x_next, y_next, psi_next, v_next])
"""

CONTROLLER = """\
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
"""


class Work(NamedTuple):
    """A submission, and what is expected of it."""

    model: str
    controller: str
    points: float
    sentence: str  #: in the report
    files: tuple[str, str] = ('bike_model.py', 'controller.py')


def _read(table: str) -> dict[str, Work]:
    """Return the works of a table: name, points and sentence, then what is replaced by what."""
    works: dict[str, Work] = {}
    for line in table.strip().splitlines():
        if not line.startswith(' '):
            name, points, sentence = line.split(' | ')
            work = Work(MODEL, CONTROLLER, float(points), sentence)
        else:
            old, new = line.strip().split(' -> ')
            change = (old, new.replace('⏎', '\n        '))
            part = 'model' if old in work.model else 'controller'
            work = work._replace(**{part: replaced(getattr(work, part), change)})
        works[name] = work
    return works


WORKS = _read("""
the published law | 100 | RMS error 0.101 m/s after the first 10 m, maximum 0.367
    + error -> + error⏎if self.int_error >= 10:⏎    self.int_error = 10
    I = self.ki -> if self.int_error <= -10:⏎    self.int_error = -10⏎I = self.ki
no limit of the sum | 100 | with kp 10, ki 0.5, kd 0.4 (controller.py, line 38)
everything with dt | 100 | with kp 30, ki 60, kd 0.2
    + error -> + error * 0.02
    (error - self.previous) -> (error - self.previous) / 0.02
    PID(kp=10, ki=0.5, kd=0.4) -> PID(30, 60, 0.2)
trapezoids with dt, added after the answer | 98.81 | right in all 240 outputs
    self.int_error = self.int_error + error -> pass
    self.previous = 0 -> self.previous = self.last = 0
    return acc -> self.int_error += 0.01 * (error + self.last); self.last = error; return acc
brackets without a product | 50 | is a * missing before a bracket
    = self.kp * error -> = self.kp(error)
other names of the gains | 100 | with kp 10, ki 0.5, kd 0.4
    kp=1, ki=1, kd=1 -> P=2.0, I=0.0, D=1.0, Derivator=0, Integrator=0
    = kp -> = P
    = ki -> = I
    = kd -> = D
    PID(kp=10, ki=0.5, kd=0.4) -> PID(P=10, I=0.5, D=0.4)
gains in another order | 100 | with kp 10, ki 0.5, kd 0.4
    kp=1, ki=1, kd=1 -> kp, kd, ki
    PID(kp=10, ki=0.5, kd=0.4) -> PID(10, 0.4, 0.5)
gains as defaults | 100 | with kp 10, ki 0.5, kd 0.4 (defaults, controller.py, line 14)
    kp=1, ki=1, kd=1 -> kp=10, ki=0.5, kd=0.4
    PID(kp=10, ki=0.5, kd=0.4) -> PID()
gains as constants | 100 | with kp 10, ki 0.5, kd 0.4 (controller.py, line
    v_x = 0 -> v_x = 0; KP, KI, KD = 10, 0.5, 0.4
    PID(kp=10, ki=0.5, kd=0.4) -> PID(KP, KI, KD)
a global sum | 100 | I has no dt
    v_x = 0 -> v_x = 0; int_error = 0
    self.int_error = self.int_error + error -> global int_error; int_error = int_error + error
    self.ki * self.int_error -> self.ki * int_error
NumPy scalars | 100 | D has no dt
    from numpy import pi -> import numpy as np
    return acc -> return np.array([acc])
    self.int_error = 0 -> self.int_error = np.zeros(1)
whole numbers | 86.04 | the outputs are whole numbers
    return acc -> return int(acc)
an unused import | 100 | imports matplotlib.pyplot: it is not installed here
    import time -> import matplotlib.pyplot as plt
a ROS clock | 50 | rospy.get_time(), but ROS 1 is not installed
    + error -> + error * (rospy.get_time() - self.previous)
an error at a low speed | 50 | on the road: controller.py, line
    # integral -> if speed_current > 7.9: acc = missing
print of Python 2 | 50 | this is the print of Python 2: write print('acc', acc)
    return acc -> print 'acc', acc⏎return acc
a shadowed sin | 50 | does a variable have the name of a function?
    g = 9.8 -> g = 9.8; sin = 1
""")
WORKS['names of files'] = WORKS['no limit of the sum']._replace(
    sentence='Bike_Model.py is taken as bike_model.py',
    files=('Bike_Model.py', 'controller_final(1).py'),
)
