import time


class PID:
    def __init__(self, kp, ki, kd):
        self.calls = 0

    def acc_calculate(self, speed_reference, speed_current):
        self.calls += 1
        if self.calls % 10 == 3:
            time.sleep(0.05)
        return 10.0 * (speed_reference - speed_current)
