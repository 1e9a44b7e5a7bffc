"""What moves: bicycles, tyres, integrators, actuators, the sensor, the road, and their parameters.

Nothing here decides, and nothing here imports ROS.
"""
