from math import asin, atan, atan2, copysign, cos, hypot, pi, sin, sqrt

L = 3.0
l_r = 1.5


def wrap(angle):
    return atan2(sin(angle), cos(angle))


def straight_errors(x, y, psi, x_0, y_0, psi_0):
    e_y = (y - y_0) * cos(psi_0) - (x - x_0) * sin(psi_0)
    e_psi = wrap(psi - psi_0)
    return [e_y, e_psi]


def arc_errors(x, y, psi, x_c, y_c, radius):
    side = copysign(1.0, radius)
    distance = hypot(x - x_c, y - y_c)
    heading = atan2(y - y_c, x - x_c) + side * pi / 2
    e_y = radius - side * distance
    e_psi = wrap(psi - heading)
    return [e_y, e_psi]


def steady(curvature):
    sine = l_r * curvature
    delta = atan(L * curvature / sqrt(1 - sine**2))
    e_psi = -asin(sine)
    return [delta, e_psi]


class Lane:
    def __init__(self):
        self.k_y = 0.22
        self.k_psi = 0.95

    def steer_calculate(self, e_y, e_psi, speed, curvature):
        k = curvature(0.0)
        delta, e_steady = steady(k)
        e = e_psi - e_steady
        steer = delta - self.k_y * e_y - self.k_psi * e
        return steer
