from math import atan, cos, sin, tan

l_f = 1.5
l_r = 1.5
g = 9.8


def sign(v):
    return (v > 0) - (v < 0)


def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):
    beta = atan(l_r / (l_f + l_r) * tan(d_f))
    F_ext = -m * g * sin(theta) - (a0 * v**2 + Ff) * sign(v)
    x_next = x + ts * v * cos(psi + beta)
    y_next = y + ts * v * sin(psi + beta)
    psi_next = psi + ts * v / l_r * sin(beta)
    v_next = v + ts * (a + F_ext / m)
    return [x_next, y_next, psi_next, v_next]
