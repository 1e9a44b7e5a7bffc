"""Whether a bag could have come from the code that it claims. No ROS."""
