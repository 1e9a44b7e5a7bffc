"""A relay that always drives a curve, whatever the driver wants."""


def relay(linear_x, angular_z):
    return [2.5, 0.0625]
