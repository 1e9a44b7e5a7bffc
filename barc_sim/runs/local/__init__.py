"""Carries the messages of a run without ROS, by calls in one thread."""
