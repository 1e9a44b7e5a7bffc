"""The car's model, as a student writes it."""

from math import atan, cos, sin, tan

l_f = 1.5  # [m] from the centre of mass to the front axle
l_r = 1.5  # [m] from the centre of mass to the rear axle
g = 9.8  # [m/s^2] gravity


def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):
    """Return the car's state one step of forward Euler later, as [x, y, psi, v]."""
    beta = atan(l_r / (l_f + l_r) * tan(d_f))

    direction = (v > 0) - (v < 0)
    F_ext = -m * g * sin(theta) - (a0 * v**2 + Ff) * direction

    x_next = x + ts * v * cos(psi + beta)
    y_next = y + ts * v * sin(psi + beta)
    psi_next = psi + ts * v / l_r * sin(beta)
    v_next = v + ts * (a + F_ext / m)
    return [x_next, y_next, psi_next, v_next]
