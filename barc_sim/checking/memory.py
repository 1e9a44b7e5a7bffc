"""Judges what a PID remembers: its past within a run, nothing of another run, and to come back."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barc_sim.checking.finding import Finding
from barc_sim.checking.sequences import Sequence, constant, wandering
from barc_sim.checking.situations import TS
from barc_sim.errors import UserError
from barc_sim.pid import ACCELERATION_LIMIT

if TYPE_CHECKING:
    from barc_sim.checking.code import Code

_GAINS = (1.0, 2.0, 0.01)
_ALONE = {'the integral': (0.0, 2.0, 0.0), 'the last error': (0.0, 0.0, 0.01)}
_WINDUP_GAINS = (1.0, 2.0, 0.0)
_PUSHED, _PULLED = 5.0, -0.5  #: [m/s] errors, into the limit and out of it
_PUSHES, _PULLS = 300, 600  #: calls
_ALLOWED = 25  #: calls until the output leaves the limit
_TOLERANCE = 1e-9  #: [m/s²]


def judge_reset(code: Code, seed: int) -> Finding:
    """Return whether each `PID` starts anew: a second one, one beside it, and one that is reset.

    The score is the share of these that hold, without the last where there is no `reset()`.
    """
    try:
        return _judge_reset(code, wandering(seed, 'pid.reset', 0.3))
    except UserError as error:
        return Finding('pid.reset', 0.0, str(error))


def _judge_reset(code: Code, sequence: Sequence) -> Finding:
    proportional = [code.new_pid(1.0, 0.0, 0.0).acc_sequence(sequence.rows) for _ in range(2)]
    if _differ(*proportional):
        return Finding(
            'pid.reset',
            0.0,
            'the same speeds give different outputs, with kp alone: is there anything random in '
            'PID, or does it keep its output in a global variable?',
            {'leaks': True},
        )
    first = code.new_pid(*_GAINS).acc_sequence(sequence.rows)
    if not any(first):
        return Finding('pid.reset', 0.0, 'the output is always 0: there is nothing to remember')
    says, checks = [], 2
    if _differ(first, code.new_pid(*_GAINS).acc_sequence(sequence.rows)):
        says.append(
            f'{_kept(code, sequence)} of one run reaches into the next: is it kept in a global or '
            'class variable? Set it to 0 in __init__, as self.…'
        )
    if _differ(first, _beside_another(code, sequence)):
        says.append('two PIDs at the same time share what they remember: keep it in self')
    pid = code.new_pid(*_GAINS)
    pid.acc_sequence(sequence.rows)
    if pid.reset():
        checks += 1
        if not says and _differ(first, pid.acc_sequence(sequence.rows)):
            says.append(f'reset() does not forget {_kept(code, sequence, reset=True)}')
    score = 1.0 - len(says) / checks
    details = {'leaks': _differ(first, code.new_pid(*_GAINS).acc_sequence(sequence.rows))}
    return Finding('pid.reset', score, '; '.join(says) or 'each run starts anew', details)


def _beside_another(code: Code, sequence: Sequence) -> list[float]:
    one, other = code.new_pid(*_GAINS), code.new_pid(*_GAINS)
    outputs = []
    for reference, measured, dt in sequence.rows:
        outputs.append(one.acc_calculate(reference, measured, dt))
        other.acc_calculate(reference, measured - 0.3, dt)
    return outputs


def _kept(code: Code, sequence: Sequence, *, reset: bool = False) -> str:
    """Return what of a run is still there in the next one."""
    kept = []
    for name, gains in {
        'the integral': (0.0, 2.0, 0.0),
        'the last error': (0.0, 0.0, 0.01),
    }.items():
        pid = code.new_pid(*gains)
        first = pid.acc_sequence(sequence.rows)
        if reset:
            pid.reset()
        else:
            pid = code.new_pid(*gains)
        if _differ(first, pid.acc_sequence(sequence.rows)):
            kept.append(name)
    return ' and '.join(kept) or 'something'


def _differ(one: list[float], other: list[float]) -> bool:
    return bool(np.max(np.abs(np.subtract(one, other))) > _TOLERANCE)


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
    pid = code.new_pid(*_WINDUP_GAINS)
    pushed = sign * np.array(pid.acc_sequence(constant(sign * _PUSHED, _PUSHES).rows))
    if not pushed.max() > pushed[0]:
        return None
    pulled = sign * np.array(pid.acc_sequence(constant(sign * _PULLED, _PULLS).rows))
    inside = np.flatnonzero(pulled < min(float(pushed.max()), ACCELERATION_LIMIT) - _TOLERANCE)
    return int(inside[0]) if inside.size else _PULLS
