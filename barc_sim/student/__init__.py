"""A student's own code: loaded as it is, called with checks. No ROS, nothing of the reference."""
