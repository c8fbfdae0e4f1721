"""A law with a memory, an integral that starts from what was sent, and two numbers to tune."""


class Law:
    def __init__(self):
        self.k_psi, self.k_i = 0.12, 0.02
        self.integral = 0.0

    def reset(self):
        self.integral = 0.0

    def update(self, m):
        _, dtheta, psi, dpsi = m.x
        error = psi - m.reference
        self.integral += m.dt * error
        torque = -0.006 * dtheta - self.k_psi * error - 0.04 * dpsi - self.k_i * self.integral
        return torque, {"error_rad": error, "integral_rad_s": self.integral}

    def tune(self, key, value):
        known = key in ("k_psi", "k_i")
        if known:
            setattr(self, key, value)
        return known
