"""The cruise control: write the class PID."""


class PID:
    """A PID controller that holds a speed.

    The car's motor gives at most 8 m/s^2, either way: what is beyond that is cut off. What your
    integral does meanwhile is up to you (look for "windup").
    """

    def __init__(self, kp, ki, kd):
        """Keep the gains, and set what is kept between calls to its start.

        kp  [1/s]    proportional gain
        ki  [1/s^2]  integral gain
        kd  [-]      derivative gain

        Named self.kp, self.ki and self.kd, they can be changed while the car drives.
        """
        self.kp = kp
        self.ki = ki
        self.kd = kd
        # TODO: what the integral and the derivative need

    def acc_calculate(self, speed_reference, speed_current):
        """Return the acceleration to command [m/s^2]; called once each 0.02 s.

        speed_reference  [m/s]  the speed to hold
        speed_current    [m/s]  the measured speed

        With a third argument, named dt, it is also told the time since the last call [s],
        0.02 at the first. Terms that are kept as self.proportional, self.integral and
        self.derivative [m/s^2] are recorded, and drawn beside the speed.
        """
        # TODO: the error, and the three terms

        # Then put in place of the next line: return the sum of the terms
        raise NotImplementedError
