class Lane:
    def __init__(self, k_y=0.2, k_psi=0.8):
        self.k_y = k_y
        self.k_psi = k_psi
        self.sum = 0.0

    def steer_calculate(self, e_y, e_psi, speed, curvature):
        self.feedforward = 3.0 * curvature(0.0)
        self.sum += e_y * 1e-5
        return self.feedforward - self.k_y * e_y - self.k_psi * e_psi - self.sum
