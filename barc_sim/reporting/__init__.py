"""A run as one HTML page. No ROS."""
