"""Vehicle and controller together: the closed loop, the log of a run, and figures of its quality.

Nothing here is in real time or knows of ROS.
"""
