"""The search for gains over many closed loops, and a car's parameters from its logs."""

from barc_sim.simulation.scenario import LIMITS

#: The limits of a distance that a car can reach.
SPEED = LIMITS['speed_reference']._replace(between=(0.1, 100.0))
DISTANCE = LIMITS['distance']._replace(between=(10.0, 1e5))
#: Resamples of a bootstrap; fewer give no percentile of 2.5 %.
MIN_RESAMPLES = 40
