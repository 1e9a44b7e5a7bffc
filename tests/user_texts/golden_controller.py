"""A PID as a student writes it: a limited integral, and the derivative of the error."""


class PID:
    def __init__(self, kp, ki, kd):
        self.kp = kp
        self.ki = ki
        self.kd = kd
        self.sum = 0.0
        self.last = None

    def acc_calculate(self, speed_reference, speed_current, dt):
        error = speed_reference - speed_current
        self.sum = max(-0.05, min(self.sum + error * dt, 0.05))
        change = 0.0 if self.last is None else (error - self.last) / dt
        self.last = error
        self.proportional = self.kp * error
        self.integral = self.ki * self.sum
        return self.proportional + self.integral + self.kd * change
