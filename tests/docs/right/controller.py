"""A right answer to the lab's second task."""


class PID:
    """A PID that holds a speed; its integral stops at the motor's limit."""

    def __init__(self, kp=10.0, ki=20.0, kd=0.0):
        self.kp, self.ki, self.kd = kp, ki, kd
        self.integral = 0.0
        self.previous = None

    def acc_calculate(self, speed_reference, speed_current):
        """Return the acceleration [m/s²]; called once each 0.02 s."""
        error = speed_reference - speed_current
        derivative = step = 0.0
        if self.previous is not None:
            derivative = -self.kd * (speed_current - self.previous) / 0.02
            step = self.ki * error * 0.02
        self.previous = speed_current
        wanted = self.kp * error + self.integral + step + derivative
        if not (wanted > 8.0 and step > 0.0) and not (wanted < -8.0 and step < 0.0):
            self.integral += step
        return self.kp * error + self.integral + derivative


pid = PID(kp=10.0, ki=20.0, kd=0.0)
