class PID:
    def __init__(self, kp, ki, kd, scale=1.0):
        self.kp, self.ki, self.kd, self.scale = kp, ki, kd, scale
        self.calls = 0

    def acc_calculate(self, speed_reference, speed_current):
        self.calls += 1
        self.proportional = self.scale * self.kp * (speed_reference - speed_current)
        return self.proportional + self.calls
