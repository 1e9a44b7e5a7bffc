"""The search for gains over many closed loops, and a car's parameters from its logs."""

from barc_sim.control import cruise_control
from barc_sim.simulation import stepper

#: The limits of a distance that a car can reach.
SPEED = cruise_control.SPEED._replace(between=(0.1, 100.0))
DISTANCE = stepper.DISTANCE._replace(default=180.0, between=(10.0, 1e5))
