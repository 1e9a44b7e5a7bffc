"""Judges a student's `bikeFE` and `PID` against the reference: what `check` and `grade` share.

Pure: no ROS, no wall clock, no randomness but the seed's, so that a score is the same on every
machine. Tolerances are far above what mathematical libraries differ by, and far below any mistake.
"""
