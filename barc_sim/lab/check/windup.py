"""Judges whether the integral grows while the output is at its limit (windup)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barc_sim.control.pid import ACCELERATION_LIMIT
from barc_sim.errors import UserError
from barc_sim.lab.check.findings import judges
from barc_sim.lab.check.situations import TS, constant

if TYPE_CHECKING:
    from barc_sim.lab.check.code import JudgedCode
    from barc_sim.lab.check.findings import Judged

_GAINS = (1.0, 2.0, 0.0)
_PUSHED, _PULLED = 3.0, -0.5  #: [m/s] errors: into the limit, and out of it
_PUSHES, _PULLS = 300, 600  #: calls
_GROWN = 0.5  #: [m/s²] The least growth that shows an integral.
_ALLOWED = 25  #: calls until the output leaves the limit
_ABSURD = 1e6  #: [m/s²] Beyond any sum of the terms.
_TOLERANCE = 1e-9  #: [m/s²]


@judges('pid.windup')
def judge_windup(code: JudgedCode) -> Judged:
    """Return whether the output leaves its limit when the error changes its sign.

    The car's motor gives ±8 m/s² at most, also if the class has no such limit. Half a second or
    less is full marks; beyond that the score falls with the time.

    Examples
    --------
    >>> from barc_sim import PID
    >>> from barc_sim.lab.check.code import LocalCode
    >>> from barc_sim.lab.user_code.loading import UserCode
    >>> judge_windup(LocalCode(UserCode(controller=PID))).passed
    True
    """
    calls = [_recovery(code, sign) for sign in (1.0, -1.0)]
    scores = [min(1.0, _ALLOWED / max(n, 1)) if n < _PULLS else 0.0 for n in calls]
    if min(scores) == 1.0:
        return 1.0, 'the output leaves its limit when the error changes its sign'
    longest = max(calls)
    time = f'{longest * TS:.1f} s' if longest < _PULLS else f'more than {_PULLS * TS:g} s'
    return float(np.mean(scores)), (
        f'the integral winds up: after {_PUSHES * TS:g} s with the output at its limit of '
        f'{ACCELERATION_LIMIT:g} m/s² the error changed its sign, and the output stayed there for '
        f'{time}. Do not add to the integral while the output is at its limit'
    )


def _recovery(code: JudgedCode, sign: float) -> int:
    """Return the number of calls until the output leaves its limit."""
    pid = code.new_pid(*_GAINS, limit=ACCELERATION_LIMIT)
    pushed = sign * np.array(pid.acc_sequence(constant(sign * _PUSHED, _PUSHES).rows))
    if pushed.max() <= _GAINS[0] * _PUSHED + _GROWN:
        raise UserError(
            'the output does not grow while the error stays the same: is there an integral?'
        )
    pulled = sign * np.array(pid.acc_sequence(constant(sign * _PULLED, _PULLS).rows))
    greatest = float(np.abs([*pushed, *pulled]).max())
    if not greatest < _ABSURD:
        raise UserError(
            f'the output reaches {greatest:.3g} m/s² while the error is {_PUSHED:g} m/s at most'
        )
    inside = np.flatnonzero(pulled < min(float(pushed.max()), ACCELERATION_LIMIT) - _TOLERANCE)
    return int(inside[0]) if inside.size else _PULLS
