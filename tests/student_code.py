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
    points: tuple[float, float, float]  #: by the rubrics lab, strict, extended
    sentence: str  #: in the report
    files: tuple[str, str] = ('bike_model.py', 'controller.py')


def _pid(points: tuple[float, float, float], sentence: str, *pairs: tuple[str, str]) -> Work:
    return Work(MODEL, replaced(CONTROLLER, *pairs), points, sentence)


def _model(points: tuple[float, float, float], sentence: str, *pairs: tuple[str, str]) -> Work:
    return Work(replaced(MODEL, *pairs), CONTROLLER, points, sentence)


_SUM = 'self.int_error = self.int_error + error'
_D = 'D = self.kd * (error - self.previous)'
_CALL = 'PID(kp=10, ki=0.5, kd=0.4)'
_CLAMP = f"""{_SUM}
        if self.int_error >= 10:
            self.int_error = 10
        if self.int_error <= -10:
            self.int_error = -10"""

WORKS: dict[str, Work] = {
    'the published law': _pid(
        (100.0, 90.67, 95.55),
        'RMS error 0.101 m/s after the first 10 m, at most 0.367',
        (_SUM, _CLAMP),
    ),
    'no limit of the sum': _pid(
        (100.0, 90.67, 91.55), 'with kp 10, ki 0.5, kd 0.4 (controller.py, line 38)'
    ),
    'clamped in one line': _pid(
        (100.0, 90.67, 91.55),
        'I has no dt',
        (
            _SUM,
            _SUM.replace(
                '= self.int_error + error', '= max(-500, min(500, self.int_error + error))'
            ),
        ),
    ),
    'everything with dt': _pid(
        (100.0, 96.0, 94.25),
        'with kp 30, ki 60, kd 0.2',
        (_SUM, _SUM + ' * 0.02'),
        (_D, _D + ' / 0.02'),
        (_CALL, 'PID(30, 60, 0.2)'),
    ),
    'trapezoids': _pid(
        (100.0, 90.67, 91.54),
        'I has no dt',
        (
            _SUM,
            _SUM.replace('error', '(error + self.previous) / 2.0').replace(
                'int_(error + self.previous) / 2.0', 'int_error'
            ),
        ),
    ),
    'added after the answer': _pid(
        (100.0, 90.67, 91.54),
        'I has no dt',
        (f'        {_SUM}\n', ''),
        ('        return acc', f'        {_SUM}\n        return acc'),
    ),
    'trapezoids with dt, added after the answer': _pid(
        (98.81, 92.69, 92.28),
        'right in all 240 outputs',
        (f'        {_SUM}\n', ''),
        ('self.previous = 0', 'self.previous = self.last = 0'),
        (
            '        return acc',
            '        self.int_error += 0.01 * (error + self.last); self.last = error; return acc',
        ),
    ),
    'a product in place of a sum': _pid(
        (91.07, 82.17, 83.97),
        'I is always 0: is ki used, and is each error added to the sum?',
        (_SUM, 'self.int_error = self.int_error * error'),
    ),
    'a list of errors': _pid(
        (100.0, 90.67, 91.55),
        'I has no dt',
        ('self.int_error = 0', 'self.int_error = []'),
        (_SUM, 'self.int_error.append(error)'),
        ('* self.int_error\n', '* sum(self.int_error)\n'),
    ),
    'a window of 20 errors': _pid(
        (92.0, 82.67, 88.58),
        'I adds up the last 20 errors only',
        ('self.int_error = 0', 'self.int_error = []'),
        (_SUM, 'self.int_error = (self.int_error + [error])[-20:]'),
        ('* self.int_error\n', '* sum(self.int_error)\n'),
    ),
    'P only': _pid(
        (84.0, 74.67, 73.58),
        'I is always 0: is ki used, and is each error added to the sum?',
        ('self.kp * error + I + D', 'self.kp * error'),
        (_CALL, 'PID(kp=20, ki=0, kd=0)'),
    ),
    'PD': _pid((91.07, 82.17, 83.97), 'I is always 0', ('error + I + D', 'error + D')),
    'PI': _pid((92.0, 82.67, 84.55), 'D is always 0', ('error + I + D', 'error + I')),
    'derivative of the error itself': _pid(
        (92.0, 82.67, 84.55),
        'D does not store the error of the last call',
        (_D, 'D = self.kd * error'),
    ),
    'a derivative that forgets': _pid(
        (92.0, 82.67, 84.55), 'D does not store the error', ('        self.previous = error\n', '')
    ),
    'a derivative after its error is stored': _pid(
        (92.0, 82.67, 84.55),
        'is the error of the last call replaced only after D has used it?',
        ('        self.previous = error\n', ''),
        (_D, f'self.previous = error\n        {_D}'),
    ),
    'gains without self': _pid(
        (50.0, 50.0, 49.25),
        "NameError: name 'kp' is not defined: did you mean self.kp?",
        ('= self.kp * error', '= kp * error'),
    ),
    'brackets without a product': _pid(
        (50.0, 50.0, 49.25),
        "'float' object is not callable: self.kp is 0.5: is a * missing before the bracket?",
        ('= self.kp * error', '= self.kp(error)'),
    ),
    'the wrong sign': _pid(
        (50.0, 50.0, 53.25),
        'P has the wrong sign',
        ('speed_reference - speed_current', 'speed_current - speed_reference'),
    ),
    'I with the wrong sign': _pid(
        (66.0, 68.67, 68.58), 'I has the wrong sign', ('error + I', 'error - I')
    ),
    'other names of the gains': _pid(
        (100.0, 90.67, 91.55),
        'with kp 10, ki 0.5, kd 0.4',
        ('kp=1, ki=1, kd=1', 'P=2.0, I=0.0, D=1.0, Derivator=0, Integrator=0'),
        ('= kp', '= P'),
        ('= ki', '= I'),
        ('= kd', '= D'),
        (_CALL, 'PID(P=10, I=0.5, D=0.4)'),
    ),
    'gains in another order': _pid(
        (100.0, 90.67, 91.55),
        'with kp 10, ki 0.5, kd 0.4',
        ('kp=1, ki=1, kd=1', 'kp, kd, ki'),
        (_CALL, 'PID(10, 0.4, 0.5)'),
    ),
    'gains as defaults': _pid(
        (100.0, 90.67, 91.55),
        'with kp 10, ki 0.5, kd 0.4 (controller.py, defaults, line 14)',
        ('kp=1, ki=1, kd=1', 'kp=10, ki=0.5, kd=0.4'),
        (_CALL, 'PID()'),
    ),
    'gains as constants': _pid(
        (100.0, 90.67, 91.55),
        'with kp 10, ki 0.5, kd 0.4 (controller.py, constants, line',
        ('v_x = 0\n\ndef', 'v_x = 0\nKP, KI, KD = 10, 0.5, 0.4\n\ndef'),
        (_CALL, 'PID(KP, KI, KD)'),
    ),
    'gains that are ignored': _pid(
        (76.0, 64.0, 69.22),
        'the gains that PID gets have no effect',
        ('= kp', '= 10'),
        ('= ki', '= 0.5'),
        ('= kd', '= 0.4'),
    ),
    'a global sum': _pid(
        (100.0, 90.67, 87.55),
        'one run changes the next (the integral)',
        ('v_x = 0\n\ndef', 'v_x = 0\nint_error = 0\n\ndef'),
        (_SUM, 'global int_error\n        int_error = int_error + error'),
        ('* self.int_error\n', '* int_error\n'),
        ('        self.int_error = 0\n', ''),
    ),
    'NumPy scalars': _pid(
        (100.0, 90.67, 91.55),
        'I has no dt',
        ('from numpy import pi', 'import numpy as np'),
        ('return acc', 'return np.array([acc])'),
        ('self.int_error = 0', 'self.int_error = np.zeros(1)'),
    ),
    'whole numbers': _pid(
        (76.0, 64.0, 69.2), 'the outputs are whole numbers', ('return acc', 'return int(acc)')
    ),
    'an own limit': _pid(
        (81.62, 80.77, 79.91), 'I has no dt', ('return acc', 'return max(-8, min(8, acc))')
    ),
    'an unused import': _pid(
        (100.0, 90.67, 91.55),
        'import matplotlib.pyplot as plt: not here',
        ('import time', 'import matplotlib.pyplot as plt'),
    ),
    'a ROS clock': _pid(
        (50.0, 50.0, 49.25),
        'rospy.get_time(), but ROS 1 is not here',
        (_SUM, 'dt = rospy.get_time() - self.previous\n        self.int_error += error * dt'),
    ),
    'no return': _pid((50.0, 50.0, 49.25), 'is its return missing?', ('        return acc\n', '')),
    'an error at a low speed': _pid(
        (50.0, 50.0, 49.25),
        'on the road: controller.py, line',
        ('        # integral', '        if speed_current > 7.9: acc = missing'),
    ),
    'print of Python 2': _pid(
        (50.0, 50.0, 49.25),
        "this is the print of Python 2: write print('acc', acc)",
        ('return acc', "print 'acc', acc\n        return acc"),
    ),
    'a missing colon': _pid(
        (50.0, 50.0, 49.25), "syntax error: expected ':'", ('class PID():', 'class PID()')
    ),
    'the template': _pid(
        (50.0, 50.0, 49.25),
        'is its return missing?',
        (
            CONTROLLER[CONTROLLER.index('        error =') : CONTROLLER.index('def controller')],
            '        pass\n\n',
        ),
        (_CALL, 'PID()'),
    ),
    'names of files': _pid(
        (100.0, 90.67, 91.55), 'Bike_Model.py is taken as bike_model.py'
    )._replace(files=('Bike_Model.py', 'controller_final(1).py')),
    'a shadowed sin': _model(
        (50.0, 40.67, 42.3), 'sin is 1 here', ('\tg = 9.8', '\tg = 9.8\n\tsin = 1')
    ),
    'theta in degrees': _model(
        (88.8, 79.47, 82.09),
        'is it converted from degrees once more?',
        ('sin(theta)', 'sin(theta*3.141592653589793/180)'),
    ),
    'friction by sign': _model(
        (100.0, 90.67, 92.3), 'right in all', ('a0*v**2 - Ff', '(a0*v**2 + Ff)*sign(v)')
    ),
    'no hills': _model((88.8, 79.47, 82.09), 'gravity is missing', ('-m*g*sin(theta) - a0', '-a0')),
    "the lab's template": _model(
        (50.0, 40.67, 42.3), 'is not written yet (TODO)', ('l_f = 1.5', 'l_f = TODO')
    ),
    'gravity on the flat': _model(
        (78.0, 68.67, 73.3),
        'gravity acts on the flat, too: it is -m * g * sin(theta); and F_ext has the wrong sign',
        ('-m*g*sin(theta) - a0*v**2 - Ff', 'm*g + a0*v**2 + Ff'),
    ),
    'gravity without m': _model(
        (78.01, 68.68, 73.3),
        'm and sin(theta) are missing in gravity: the force is -m * g * sin(theta)',
        ('-m*g*sin(theta) - a0*v**2 - Ff', '-g - a0*v**2 - Ff'),
    ),
    'Ff as the whole force': _model(
        (78.0, 68.67, 73.3),
        'the rate of change is returned in place of v_next = v + ts * rate; and F_ext is Ff alone',
        ('-m*g*sin(theta) - a0*v**2 - Ff', 'Ff'),
        ('v_next = v + ts*(a + F_ext/m)', 'v_next = a + F_ext/m'),
    ),
    'a list of results': _model(
        (100.0, 90.67, 91.55),
        'right in all',
        ('array([x_next, y_next, psi_next, v_next])', '[x_next, y_next, psi_next, v_next]'),
    ),
}
