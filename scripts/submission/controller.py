KP = 30.0


class PID:
    def __init__(self, kp, ki, kd):
        self.kp = kp
        self.ki = ki
        self.kd = kd
        self.sum = 0
        self.last = 0

    def acc_calculate(self, speed_reference, speed_current):
        e = speed_reference - speed_current
        self.sum += e
        change = e - self.last
        self.last = e
        return self.kp * e + self.ki * self.sum + self.kd * change


pid = PID(kp=KP, ki=0.5, kd=0.4)
