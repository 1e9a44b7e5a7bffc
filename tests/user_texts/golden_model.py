"""The lab's model as a student writes it: resistance by the sign of the speed, nothing more."""

from math import atan, cos, sin, tan

L_F = L_R = 1.5
G = 9.8


def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):
    beta = atan(L_R / (L_F + L_R) * tan(d_f))
    sign = (v > 0) - (v < 0)
    f_ext = -m * G * sin(theta) - (a0 * v**2 + Ff) * sign
    x_next = x + ts * v * cos(psi + beta)
    y_next = y + ts * v * sin(psi + beta)
    psi_next = psi + ts * v / L_R * sin(beta)
    v_next = v + ts * (a + f_ext / m)
    return [x_next, y_next, psi_next, v_next]
