"""Judges what a `PID` keeps between calls: its fresh start, and its integral at the limit."""

from __future__ import annotations

from functools import partial
from math import inf
from random import Random
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.control.pid import ACCELERATION_LIMIT
from barc_sim.errors import UserError
from barc_sim.lab.check.code import judges
from barc_sim.lab.hills.loop import NOT_A_CAR
from barc_sim.lab.hills.model import TS

if TYPE_CHECKING:
    from collections.abc import Callable

    from barc_sim.lab.check.code import Judged, JudgedCode, JudgedController, Sample

    Gains = tuple[float, float, float]  # kp, ki, kd

TOLERANCE = 1e-9  #: [m/s²]
_LENGTH = 120  #: calls of a sequence


def wandering(seed: int, name: str, amplitude: float, max_sum: float = inf) -> list[Sample]:
    """Return calls with random errors up to ±`amplitude` [m/s], and a reference that changes.

    The errors are smaller where their sum would reach more than `max_sum` [m/s].
    """
    uniform = Random(f'{seed} {name}').uniform  # noqa: S311 (a simulation, not a secret)
    error = amplitude * np.array([uniform(-1.0, 1.0) for _ in range(_LENGTH)])
    error[40:60] = amplitude * uniform(0.5, 1.0)  # a constant error for a while
    steps = [uniform(-0.5, 0.5) for _ in range(4)]
    reference = 8.0 + amplitude * np.repeat(steps, _LENGTH // 4)
    largest_sum = float(np.abs(np.cumsum(error)).max())
    measured = reference - error * min(1.0, max_sum / largest_sum)
    return [(r, v, TS) for r, v in zip(reference.tolist(), measured.tolist(), strict=True)]


_GAINS: Gains = (1.0, 2.0, 0.01)
_ALONE: dict[str, Gains] = {'the integral': (0.0, 2.0, 0.0), 'the last error': (0.0, 0.0, 0.01)}
_AMPLITUDE = 0.3  #: [m/s]
RANDOM = 'the same speeds give different outputs'


@judges('pid.reset')
def judge_reset(code: JudgedCode, seed: int) -> Judged:
    """Return whether each `PID` starts fresh: a second one, one of two, and one after `reset()`.

    The score is the share of these checks that pass; without a `reset()` the last one is left out.
    """
    own = wandering(seed, 'pid.reset', _AMPLITUDE)
    other = wandering(seed, 'pid.reset, before', _AMPLITUDE)
    new = partial(code.new_pid, fresh=False)
    if _differ(*(new(1.0, 0.0, 0.0).acc_sequence(own) for _ in range(2))):
        return _random(', with kp alone')
    used = new(*_GAINS)
    used.acc_sequence(other)
    first = new(*_GAINS).acc_sequence(own)
    if not _differ(first, used.acc_sequence(own)):
        return 0.0, 'PID keeps no errors between calls: I and D need them'
    faults, checks = [], 2
    if shared := _differ(first, new(*_GAINS).acc_sequence(own)):
        if not (kept := _parts(partial(_leaks, new, other))):
            return _random('')
        faults.append(
            f'one run changes the next ({kept}): is it in a global or class variable? '
            'Set it to 0 in __init__, as self.…'
        )
    one, another = new(*_GAINS), new(*_GAINS)
    in_turn = [
        (one.acc_calculate(*a), another.acc_calculate(*b)) for a, b in zip(own, other, strict=True)
    ]
    if _differ(first, [mine for mine, _ in in_turn]):
        faults.append('two PIDs at the same time share their values: store them in self')
    if used.reset():
        checks += 1
        if not shared and _differ(first, used.acc_sequence(own)):
            kept = _parts(partial(_keeps, new, own, other))
            faults.append(f'reset() does not clear {kept or "its output"}')
    return 1.0 - len(faults) / checks, '; '.join(faults) or 'each run starts fresh'


def _leaks(new: Callable[..., JudgedController], other: list[Sample], gains: Gains) -> bool:
    """Return whether a new PID has something of one before it."""
    still, after = _constant(0.0, 3), []
    for rows in (still, other):
        new(*gains).acc_sequence(rows)
        after.append(new(*gains).acc_sequence(still))
    return _differ(*after)


def _keeps(
    new: Callable[..., JudgedController], own: list[Sample], other: list[Sample], gains: Gains
) -> bool:
    """Return whether a PID has something of its own run before its reset."""
    pid = new(*gains)
    first = pid.acc_sequence(own)
    pid.acc_sequence(other)
    pid.reset()
    return _differ(first, pid.acc_sequence(own))


def _parts(stored: Callable[[Gains], bool]) -> str:
    """Return which of the stored values these are."""
    return ' and '.join(name for name, gains in _ALONE.items() if stored(gains))


def _random(when: str) -> Judged:
    return 0.0, (
        f"{RANDOM}{when}: does PID use random numbers, or the computer's clock? It is called "
        f'every {TS:g} s of simulated time'
    )


def _differ(one: list[float], other: list[float]) -> bool:
    return not np.allclose(one, other, rtol=0.0, atol=TOLERANCE)


def _constant(error: float, count: int) -> list[Sample]:
    """Return `count` calls with a constant `error` [m/s]."""
    return [(8.0, 8.0 - error, TS)] * count


_WINDING: Gains = (1.0, 2.0, 0.0)
_PUSHED, _PULLED = 3.0, -0.5  #: [m/s] errors: into the limit, and out of it
_PUSHES, _PULLS = 300, 600  #: calls
_GROWN = 0.5  #: [m/s²] The minimum growth that shows an integral.
_ALLOWED = 25  #: calls until the output leaves the limit


@judges('pid.windup')
def judge_windup(code: JudgedCode) -> Judged:
    """Return whether the output leaves its limit when the error changes its sign.

    The car's motor gives ±8 m/s² at most, also if the class has no such limit. Half a second or
    less is full marks; beyond that the score falls with the time.
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
    pid = code.new_pid(*_WINDING, limit=ACCELERATION_LIMIT)
    pushed = sign * np.array(pid.acc_sequence(_constant(sign * _PUSHED, _PUSHES)))
    if (maximum := pushed.max()) <= _WINDING[0] * _PUSHED + _GROWN:
        raise UserError(
            f'with an error of {_PUSHED:g} m/s for {_PUSHES * TS:g} s the output is at most '
            f'{maximum + 0.0:.3g} m/s²: is each error added to the sum, and is no limit too small?'
        )
    pulled = sign * np.array(pid.acc_sequence(_constant(sign * _PULLED, _PULLS)))
    largest = float(np.abs([*pushed, *pulled]).max())
    if not largest < NOT_A_CAR:
        raise UserError(
            f'the output reaches {largest:.3g} m/s² while the error is {_PUSHED:g} m/s at most'
        )
    inside = np.flatnonzero(pulled < min(float(maximum), ACCELERATION_LIMIT) - TOLERANCE)
    return int(inside[0]) if inside.size else _PULLS
