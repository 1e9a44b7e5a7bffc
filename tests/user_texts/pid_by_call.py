class PID:
    def __init__(self, kp, ki, kd):
        self.k = 0

    def acc_calculate(self, speed_reference, speed_current):
        self.k += 1
        k = self.k
        e = speed_reference - speed_current
        return ANSWER
