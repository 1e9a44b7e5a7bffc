"""What ROS tools know how to show of the car: poses, wheels, a path, the road; and diagnostics."""
