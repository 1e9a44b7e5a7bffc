class PID:
    def __init__(self, kp, ki, kd, dt=0.02, limit=8.0):
        self.gains = kp, ki, kd
        self.integral = self.last = 0.0
        self.limit = limit

    def acc_calculate(self, speed_reference, speed_current, dt):
        kp, ki, kd = self.gains
        e = speed_reference - speed_current
        out = kp * e + self.integral - kd * (speed_current - self.last) / dt
        self.last = speed_current
        if -self.limit < out < self.limit:
            self.integral += ki * e * dt
        return min(max(out, -self.limit), self.limit)


pid = PID(30, 200, 0.1)
