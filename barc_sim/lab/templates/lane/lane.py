"""Lane keeping: write the errors beside a line, the steady turn, and the class Lane."""

# Import what you need, for example: from math import asin, atan, atan2, cos, hypot, pi, sin, sqrt

L = 3.0  # [m] distance between the axles
l_r = 1.5  # [m] from the centre of mass to the rear axle


def straight_errors(x, y, psi, x_0, y_0, psi_0):
    """Return the errors of a car beside a straight line, as [e_y, e_psi].

    x, y      [m]    position of the car
    psi       [rad]  heading of the car; it grows over the laps
    x_0, y_0  [m]    a point of the line
    psi_0     [rad]  heading of the line

    e_y       [m]    distance of the car to the line; positive to the left of it
    e_psi     [rad]  heading of the car minus heading of the line; from -pi to pi
    """
    # TODO

    # Then replace the next line by: return [e_y, e_psi]
    raise NotImplementedError


def arc_errors(x, y, psi, x_c, y_c, radius):
    """Return the errors of a car beside an arc, as [e_y, e_psi].

    x_c, y_c  [m]    centre of the arc
    radius    [m]    positive where the track turns left, negative where it turns right

    The heading of the line is its heading at the point that is nearest to the car.
    """
    # TODO

    # Then replace the next line by: return [e_y, e_psi]
    raise NotImplementedError


def steady(curvature):
    """Return the angles of a car that stays on a circle, as [delta, e_psi].

    curvature  [1/m]  1/radius of the circle; positive to the left

    delta      [rad]  steering angle of the front wheels; positive to the left
    e_psi      [rad]  heading of the car minus heading of the circle
    """
    # TODO

    # Then replace the next line by: return [delta, e_psi]
    raise NotImplementedError


class Lane:
    """A steering law that keeps a car on the centre line of a track."""

    def __init__(self, k_e_y=0.0, k_e_psi=0.0):
        """Store the gains, and the first values of what is stored between calls.

        A run uses the defaults: write your tuned gains there. Choose any names.
        """
        self.k_e_y = k_e_y
        self.k_e_psi = k_e_psi

    def steer_calculate(self, e_y, e_psi, speed, curvature):
        """Return the steering angle of the front wheels [rad]; called every 0.02 s.

        e_y        [m]    distance to the left of the centre line
        e_psi      [rad]  heading of the car minus heading of the centre line
        speed      [m/s]  0 in the first call: do not divide by it
        curvature         a function: curvature(d) is the curvature of the centre line [1/m],
                          d metres ahead; curvature(0.0) is the one beside the car

        The car steers by at most 0.5 rad to either side.
        """
        # TODO

        # Then replace the next line by: return delta
        raise NotImplementedError
