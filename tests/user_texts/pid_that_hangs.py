class PID:
    def __init__(self, kp, ki, kd):
        pass

    def acc_calculate(self, speed_reference, speed_current):
        while speed_current == 5.0:
            pass
        if speed_current == 6.0:
            import ctypes

            ctypes.string_at(0)
        return 1.0
