"""The car's model: write bikeFE."""

# Import what you need, for example: from math import atan, cos, sin, tan. NumPy works, too.

l_f = 1.5  # [m] from the centre of mass to the front axle
l_r = 1.5  # [m] from the centre of mass to the rear axle
g = 9.8  # [m/s^2] gravity


def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):
    """Return the car's state one step of forward Euler later, as [x, y, psi, v].

    x      [m]          position along the road's surface
    y      [m]          position to the left of the road's axis
    psi    [rad]        heading; grows when the car turns left
    v      [m/s]        speed
    a      [m/s^2]      commanded acceleration
    d_f    [rad]        steering angle of the front wheels; positive to the left
    a0     [N s^2/m^2]  air drag coefficient
    m      [kg]         mass
    Ff     [N]          rolling resistance
    theta  [rad]        incline of the road; positive uphill
    ts     [s]          time step
    """
    # TODO: the angle beta between the car's axis and its velocity, from d_f, l_f and l_r

    # TODO: the force F_ext of gravity, air drag and rolling resistance; resistance acts
    # against the motion; at a standstill it is zero

    # TODO: x_next, y_next, psi_next, v_next, each from the state before the step

    # Then replace the next line by: return [x_next, y_next, psi_next, v_next]
    raise NotImplementedError
