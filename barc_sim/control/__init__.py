"""What decides: speed controllers, steering laws, and the driver whose keys become commands.

Nothing here moves a car or imports ROS.
"""
