"""Judges whether the integral grows while the output is cut."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barc_sim.control.pid import ACCELERATION_LIMIT
from barc_sim.errors import UserError
from barc_sim.lab.check.finding import WHATEVER_COMES, Finding
from barc_sim.lab.check.sequences import constant
from barc_sim.lab.check.situations import TS

if TYPE_CHECKING:
    from barc_sim.lab.check.code import Code

_GAINS = (1.0, 2.0, 0.0)
_PUSHED, _PULLED = 3.0, -0.5  #: [m/s] errors, into the limit and out of it
_PUSHES, _PULLS = 300, 600  #: calls
_GROWN = 0.5  #: [m/s²] What the integral has to add for there to be one.
_ALLOWED = 25  #: calls until the output leaves the limit
_TOLERANCE = 1e-9  #: [m/s²]


@WHATEVER_COMES
def judge_windup(code: Code) -> Finding:
    """Return whether the output comes back from its limit as soon as the error changes its sign.

    The car's motor makes ±8 m/s² at most, whether the class knows it or not. Leaving the limit
    within half a second is full marks; from there the score falls with the time it takes.
    """
    try:
        calls = [_recovery(code, sign) for sign in (1.0, -1.0)]
    except UserError as error:
        return Finding('pid.windup', 0.0, str(error))
    known = [count for count in calls if count is not None]
    if len(known) < len(calls):
        return Finding(
            'pid.windup',
            0.0,
            'the output does not grow under a lasting error: is there an integral to wind up?',
        )
    scores = [min(1.0, _ALLOWED / max(n, 1)) if n < _PULLS else 0.0 for n in known]
    score = float(np.mean(scores))
    if min(scores) == 1.0:
        return Finding('pid.windup', 1.0, 'the output leaves its limit when the error turns')
    longest = max(known)
    time = f'{longest * TS:.1f} s' if longest < _PULLS else f'more than {_PULLS * TS:g} s'
    return Finding(
        'pid.windup',
        score,
        f'the integral winds up: after {_PUSHES * TS:g} s with the output at its limit of '
        f'{ACCELERATION_LIMIT:g} m/s² the error changed its sign, and the output stayed there for '
        f'{time}. Do not add to the integral while the output is cut',
    )


def _recovery(code: Code, sign: float) -> int | None:
    """Return how many calls it takes to leave the limit; None where the integral does nothing."""
    pid = code.new_pid(*_GAINS)
    pushed = sign * np.array(pid.acc_sequence(constant(sign * _PUSHED, _PUSHES).rows))
    if not pushed.max() > _GAINS[0] * _PUSHED + _GROWN:
        return None
    pulled = sign * np.array(pid.acc_sequence(constant(sign * _PULLED, _PULLS).rows))
    inside = np.flatnonzero(pulled < min(float(pushed.max()), ACCELERATION_LIMIT) - _TOLERANCE)
    return int(inside[0]) if inside.size else _PULLS
