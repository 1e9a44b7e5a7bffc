import numpy as np


class Car:
    g = 9.8
    lengths = np.array([1.5, 1.5])


def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts, car=Car()):
    l_f, l_r = car.lengths
    beta = np.arctan(np.tan(d_f) * l_r / (l_f + l_r))
    F_ext = -m * car.g * np.sin(theta) - a0 * v * np.abs(v) - np.copysign(Ff, v)
    rate = np.array([v * np.cos(psi + beta), v * np.sin(psi + beta), v / l_r * np.sin(beta),
                     a + F_ext / m])
    return np.array([x, y, psi, v]) + ts * rate
