class PID:
    def __init__(self, kp, ki, kd):
        self.kp = kp
        self.calls = 0

    def acc_calculate(self, speed_reference, speed_current):
        self.calls += 1
        return self.kp * (speed_reference - speed_current)
