from math import atan, copysign, cos, sin, tan


def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts, *, l_f=1.5, l_r=1.5, g=9.8):
    beta = atan(l_r / (l_f + l_r) * tan(d_f))
    push = -m * g * sin(theta)
    f_ext = push - copysign(a0 * v * v + Ff, v) if v else push
    v_next = v + ts * (a + f_ext / m)
    unresisted = v + ts * (a + push / m)
    if v > 0.0:
        v_next = max(v_next, min(unresisted, 0.0))
    elif v < 0.0:
        v_next = min(v_next, max(unresisted, 0.0))
    return [
        x + ts * v * cos(psi + beta),
        y + ts * v * sin(psi + beta),
        psi + ts * v / l_r * sin(beta),
        v_next,
    ]
