"""Judges the memory of a PID: what it keeps within a run, at its limit, and in the next run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barc_sim.control.pid import ACCELERATION_LIMIT
from barc_sim.errors import UserError
from barc_sim.lab.check.findings import NOT_A_CAR, judges
from barc_sim.lab.check.situations import TS, Sequence, constant, wandering

if TYPE_CHECKING:
    from barc_sim.lab.check.code import JudgedCode, JudgedController
    from barc_sim.lab.check.findings import Judged
    from barc_sim.lab.check.stretches import Gains

_GAINS = (1.0, 2.0, 0.01)
_ALONE = {'the integral': (0.0, 2.0, 0.0), 'the last error': (0.0, 0.0, 0.01)}
_AMPLITUDE = 0.3  #: [m/s]
_TOLERANCE = 1e-9  #: [m/s²]
# Of windup:
_WINDING = (1.0, 2.0, 0.0)  #: gains
_PUSHED, _PULLED = 3.0, -0.5  #: [m/s] errors: into the limit, and out of it
_PUSHES, _PULLS = 300, 600  #: calls
_GROWN = 0.5  #: [m/s²] The least growth that shows an integral.
_ALLOWED = 25  #: calls until the output leaves the limit


@judges('pid.reset')
def judge_reset(code: JudgedCode, seed: int) -> Judged:
    """Return whether each `PID` starts fresh: a second one, one of two, and one after `reset()`.

    The score is the share of these checks that pass; without a `reset()` the last one is left out.

    Examples
    --------
    >>> from barc_sim import PID
    >>> from barc_sim.lab.check.code import LocalCode
    >>> from barc_sim.lab.user_code.loading import UserCode
    >>> judge_reset(LocalCode(UserCode(controller=PID)), seed=0).passed
    True
    """
    return _Memory(code, seed).judge()


class _Memory:
    def __init__(self, code: JudgedCode, seed: int) -> None:
        self._code = code
        self._sequence = wandering(seed, 'pid.reset', _AMPLITUDE)
        self._other = wandering(seed, 'pid.reset, before', _AMPLITUDE)

    def judge(self) -> Judged:
        proportional = (1.0, 0.0, 0.0)
        if _differ(self._run(proportional), self._run(proportional)):
            return self._random(', with kp alone')
        self._run(_GAINS, self._other)
        first = self._run(_GAINS)
        if not _differ(first, self._second_half()):
            return 0.0, 'PID keeps no errors between calls: I and D need them'
        faults, checks = [], 2
        leaks = _differ(first, self._run(_GAINS))
        if leaks and not (kept := self._kept()):
            return self._random('')
        if leaks:
            faults.append(
                f'one run changes the next ({kept}): is it in a global or class variable? '
                'Set it to 0 in __init__, as self.…'
            )
        if _differ(first, self._beside_another()):
            faults.append('two PIDs at the same time share their values: store them in self')
        if (again := self._reset_run(_GAINS)) is not None:
            checks += 1
            if not leaks and _differ(first, again):
                faults.append(f'reset() does not clear {self._not_reset()}')
        score = 1.0 - len(faults) / checks
        return score, '; '.join(faults) or 'each run starts fresh', {'random': False}

    def _run(self, gains: Gains, sequence: Sequence | None = None) -> list[float]:
        return self._new(gains).acc_sequence((sequence or self._sequence).rows)

    def _new(self, gains: Gains = _GAINS) -> JudgedController:
        return self._code.new_pid(*gains, fresh=False)

    def _second_half(self) -> list[float]:
        """Return the outputs of a PID that continues after another sequence."""
        pid = self._new()
        pid.acc_sequence(self._other.rows)
        return pid.acc_sequence(self._sequence.rows)

    def _reset_run(self, gains: Gains) -> list[float] | None:
        """Return the outputs of a PID after its reset; None if it has none."""
        pid = self._new(gains)
        pid.acc_sequence(self._other.rows)
        return pid.acc_sequence(self._sequence.rows) if pid.reset() else None

    def _beside_another(self) -> list[float]:
        one, other = self._new(), self._new()
        outputs = []
        for mine, its in zip(self._sequence.rows, self._other.rows, strict=True):
            outputs.append(one.acc_calculate(*mine))
            other.acc_calculate(*its)
        return outputs

    def _random(self, when: str) -> Judged:
        message = (
            f'the same speeds give different outputs{when}: does PID use random numbers, or the '
            f"computer's clock? It is called every {TS:g} s of simulated time"
        )
        return 0.0, message, {'random': True}

    def _kept(self) -> str:
        """Return what a new PID keeps of the run before; empty if its outputs are random."""
        still = constant(0.0, 3)
        kept = []
        self._run(_ALONE['the integral'], self._other)
        if any(self._run(_ALONE['the integral'], still)):
            kept.append('the integral')
        self._run(_ALONE['the last error'], self._other)
        after_another = self._run(_ALONE['the last error'], still)
        if _differ(after_another, self._run(_ALONE['the last error'], still)):
            kept.append('the last error')
        return ' and '.join(kept)

    def _not_reset(self) -> str:
        """Return what a PID keeps after its reset."""
        kept = [
            name
            for name, gains in _ALONE.items()
            if (again := self._reset_run(gains)) is None or _differ(self._run(gains), again)
        ]
        return ' and '.join(kept) or 'its output'


def _differ(one: list[float], other: list[float]) -> bool:
    return not np.allclose(one, other, rtol=0.0, atol=_TOLERANCE)


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
    pid = code.new_pid(*_WINDING, limit=ACCELERATION_LIMIT)
    pushed = sign * np.array(pid.acc_sequence(constant(sign * _PUSHED, _PUSHES).rows))
    if pushed.max() <= _WINDING[0] * _PUSHED + _GROWN:
        raise UserError(
            'the output does not grow while the error stays the same: is there an integral?'
        )
    pulled = sign * np.array(pid.acc_sequence(constant(sign * _PULLED, _PULLS).rows))
    greatest = float(np.abs([*pushed, *pulled]).max())
    if not greatest < NOT_A_CAR:
        raise UserError(
            f'the output reaches {greatest:.3g} m/s² while the error is {_PUSHED:g} m/s at most'
        )
    inside = np.flatnonzero(pulled < min(float(pushed.max()), ACCELERATION_LIMIT) - _TOLERANCE)
    return int(inside[0]) if inside.size else _PULLS
