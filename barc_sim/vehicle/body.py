"""The car's dimensions, as it is drawn and as its wheels roll; no force depends on them."""

HALF_TRACK = 0.86  #: [m] from the centre line to a wheel
WHEEL_RADIUS = 0.36  #: [m]
WHEEL_WIDTH = 0.26  #: [m]
