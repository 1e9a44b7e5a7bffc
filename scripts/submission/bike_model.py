from numpy import array, arctan, cos, sin, tan


def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):
    l_f = 1.5
    l_r = 1.5
    beta = arctan(l_r / (l_f + l_r) * tan(d_f))
    F_ext = -m * 9.8 * sin(theta) - a0 * v**2 - Ff
    rate = array([v * cos(psi + beta), v * sin(psi + beta), v / l_r * sin(beta), a + F_ext / m])
    return array([x, y, psi, v]) + ts * rate
