"""What decides: the speed controllers, and the driver whose keys become commands.

Nothing here moves a car or imports ROS.
"""
