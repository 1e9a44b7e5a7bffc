"""What moves: bicycles, tyres, integrators, actuators, sensor, road, track, and their parameters.

Nothing here decides, and nothing here imports ROS.
"""
