"""The relay of the drive by hand: write relay."""

dt = 0.05  # [s] the time between two calls of relay


def relay(linear_x, angular_z):
    """Return the command to the car, as [motor, servo].

    linear_x   [-]      the driver's request: 1 forward, -1 backward, 0 for neither
    angular_z  [-]      1 to the left, -1 to the right, 0 for neither

    motor      [m/s^2]  acceleration; the maximum of the car is 8, forward and backward
    servo      [rad]    steering angle of the front wheels, positive to the left; maximum 0.5

    To store a value between calls, such as the steering angle, write a class in place of the
    function: class Relay, with a method relay(self, linear_x, angular_z).
    """
    # TODO: motor and servo

    # Then replace the next line by: return [motor, servo]
    raise NotImplementedError
