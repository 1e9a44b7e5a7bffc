class Relay:
    def __init__(self):
        self.servo = 0.0

    def relay(self, linear_x, angular_z, dt):
        wanted = 0.4 * angular_z
        self.servo += max(-dt, min(dt, wanted - self.servo))
        return [3.0 * linear_x, self.servo]
