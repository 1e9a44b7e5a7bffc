"""Judges a user's `bikeFE` and `PID` against the reference: what `check` and `grade` share.

No ROS, no clock, no randomness but the seed's: a score is the same on every machine. Tolerances
are far above what mathematical libraries differ by, and far below any mistake.
"""

from barc_sim.lab.check.code import Code, Controller, LocalCode, Row
from barc_sim.lab.check.finding import CRITERIA, Finding
from barc_sim.lab.check.judging import GAINS, findings, judge

__all__ = [
    'CRITERIA',
    'GAINS',
    'Code',
    'Controller',
    'Finding',
    'LocalCode',
    'Row',
    'findings',
    'judge',
]
