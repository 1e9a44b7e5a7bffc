"""What moves: bicycles, tyres, integrators, actuators, the sensor, the road, and their parameters.

Nothing here decides or knows of ROS.
"""
