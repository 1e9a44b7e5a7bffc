"""The cruise control: write the class PID."""


class PID:
    """A PID controller that holds a speed.

    The car has no limit of acceleration, except in a run with --acceleration-limit.
    """

    def __init__(self, kp, ki, kd):
        """Store the gains, and the first values of what is stored between calls.

        kp  [1/s]    proportional gain
        ki  [1/s^2]  integral gain
        kd  [-]      derivative gain

        Gains with the names self.kp, self.ki and self.kd can be changed while the car drives.
        """
        self.kp = kp
        self.ki = ki
        self.kd = kd
        # TODO: what the integral and the derivative need

    def acc_calculate(self, speed_reference, speed_current):
        """Return the acceleration to command [m/s^2]; called every 0.02 s.

        speed_reference  [m/s]  the speed to hold
        speed_current    [m/s]  the measured speed

        If you add a third argument dt, it is the time since the last call [s], 0.02 at the first
        call. Terms in self.proportional, self.integral and self.derivative [m/s^2] are recorded,
        and drawn beside the speed.
        """
        # TODO: the error, and the three terms

        # Then replace the next line by: return the sum of the terms
        raise NotImplementedError


# A run, check and grade use your tuned gains: write them into the call below, and remove the #.
# pid = PID(kp=1.0, ki=0.0, kd=0.0)
