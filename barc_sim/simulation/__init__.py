"""Vehicle and controller together: the closed loop, the log of a run, and figures of its quality.

`stepper` is the state machine of a simulator in time. Nothing here imports ROS, or starts a timer.
"""
