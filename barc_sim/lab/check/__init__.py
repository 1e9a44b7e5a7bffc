"""Judges a user's `bikeFE` and `PID` against the reference, for `check` and `grade`.

It uses no ROS, no clock and only seeded random numbers: a score is the same on every machine.
Tolerances are far above the differences between maths libraries, and far below any mistake.
"""
