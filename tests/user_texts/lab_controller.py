class PID:
    def __init__(self, kp, ki, kd):
        self.kp = kp
        self.ki = ki
        self.kd = kd
        self.total = 0.0
        self.e_before = None

    def acc_calculate(self, speed_reference, speed_current):
        dt = 0.02
        e = speed_reference - speed_current
        self.total += e * dt
        change = 0.0 if self.e_before is None else e - self.e_before
        self.e_before = e
        P = self.kp * e
        I = self.ki * self.total
        D = self.kd * change / dt
        output = P + I + D
        return output


pid = PID(kp=30, ki=60, kd=0.1)
