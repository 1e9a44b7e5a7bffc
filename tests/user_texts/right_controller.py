class PID:
    def __init__(self, kp, ki, kd, output_min=-8.0, output_max=8.0):
        self.kp, self.ki, self.kd = kp, ki, kd
        self.output_min, self.output_max = output_min, output_max
        self.reset()

    def reset(self):
        self.proportional = self.integral = self.derivative = 0.0
        self.saturated = False
        self.previous = None

    def acc_calculate(self, speed_reference, speed_current, dt):
        error = speed_reference - speed_current
        self.proportional = self.kp * error
        increment = self.derivative = 0.0
        if self.previous is not None and dt > 0.0:
            increment = self.ki * error * dt
            self.derivative = -self.kd * (speed_current - self.previous) / dt
        self.previous = speed_current
        wanted = self.proportional + self.integral + increment + self.derivative
        output = min(max(wanted, self.output_min), self.output_max)
        self.saturated = wanted != output
        if (wanted - output) * increment <= 0.0:
            self.integral += increment
        return output


pid = PID(30, 200, 0.1)
