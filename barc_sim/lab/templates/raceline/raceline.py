"""Racing line and MPC: write the speeds of a lap, a line, and the quadratic program of an MPC."""

# You can use NumPy: import numpy as np
# Import what you need, for example: from math import sqrt

L = 3.0  # [m] distance between the axles
l_r = 1.5  # [m] from the centre of mass to the rear axle


def profile(curvatures, step):
    """Return the fastest speeds [m/s] of a lap, one for each point of a closed track.

    curvatures  [1/m]  a list of 120 numbers: 1/radius at each of them
                       (positive to the left; 0 on a straight)
    step        [m]    from each point to the next; from the last one to the first, too

    The speed is at most 12 m/s, the lateral acceleration v**2 * |curvature| at most 3.5 m/s².
    Between two points the car accelerates or brakes by at most 2 m/s², and v**2 changes linearly.
    """
    # TODO

    # Then replace the next line by: return v
    raise NotImplementedError


def line(x, y, psi, half):
    """Return the offsets [m] of a racing line from the centre line, positive to the left.

    x, y  [m]    lists of 120 numbers: points of the centre line of a closed track
    psi   [rad]  its heading at each of them
    half  [m]    the maximum offset to either side

    The best line has the smallest integral of its squared curvature over its length.
    """
    # TODO

    # Then replace the next line by: return n
    raise NotImplementedError


def predict(speed):
    """Return [a11, a12, a21, a22, b1, b2] of a step of 0.1 s at a speed [m/s]:

    e_y   after  =  a11 * e_y + a12 * e_psi + b1 * u
    e_psi after  =  a21 * e_y + a22 * e_psi + b2 * u

    e_y    [m]    distance to the left of the line
    e_psi  [rad]  heading minus heading in the steady turn
    u      [rad]  steering minus steering in the steady turn; constant during the step
    """
    # TODO

    # Then replace the next line by: return [a11, ..., b2]
    raise NotImplementedError


def program(e_y, e_psi, speed):
    """Return np.append(H, g) of the cost of ten commands, J = 1/2 u^T H u + g^T u + constant.

    With the state x_0 = (e_y, e_psi) now, and the states x_1 to x_10 of predict, the cost is

    J  =  sum of e_y**2 + e_psi**2 over x_1 to x_10  +  sum of 5 * u**2 over the ten commands
    """
    # TODO

    # Then replace the next line by: return np.append(H, g)
    raise NotImplementedError
