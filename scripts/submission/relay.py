def relay(linear_x, angular_z):
    return [2.0 * linear_x, 0.3 * angular_z]
