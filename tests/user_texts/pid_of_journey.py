class PID:
    def __init__(self, kp, ki, kd):
        self.kp, self.ki, self.kd = kp, ki, kd
        self.sum = 0.0
        self.before = None

    def acc_calculate(self, speed_reference, speed_current):
        error = speed_reference - speed_current
        self.sum += error * 0.02
        rate = 0.0 if self.before is None else (speed_current - self.before) / 0.02
        self.before = speed_current
        return self.kp * error + self.ki * self.sum - self.kd * rate
