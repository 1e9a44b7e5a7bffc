"""Judges what a PID remembers: its past within a run, and nothing of another run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barc_sim.checking.finding import Finding
from barc_sim.checking.sequences import Sequence, wandering
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from barc_sim.checking.code import Code
    from barc_sim.checking.stretches import Gains

_GAINS = (1.0, 2.0, 0.01)
_ALONE = {'the integral': (0.0, 2.0, 0.0), 'the last error': (0.0, 0.0, 0.01)}
_AMPLITUDE = 0.3  #: [m/s]
_TOLERANCE = 1e-9  #: [m/s²]


def judge_reset(code: Code, seed: int) -> Finding:
    """Return whether each `PID` starts anew: a second one, one beside it, and one that is reset.

    The score is the share of these that hold, without the last where there is no `reset()`.
    """
    try:
        return _Memory(code, seed).judge()
    except UserError as error:
        return Finding('pid.reset', 0.0, str(error))


class _Memory:
    def __init__(self, code: Code, seed: int) -> None:
        self._code = code
        self._sequence = wandering(seed, 'pid.reset', _AMPLITUDE)
        self._other = wandering(seed, 'pid.reset, before', _AMPLITUDE)

    def judge(self) -> Finding:
        proportional = (1.0, 0.0, 0.0)
        if _differ(self._run(proportional), self._run(proportional)):
            return Finding(
                'pid.reset',
                0.0,
                'the same speeds give different outputs, with kp alone: is there anything random '
                'in PID, or does it keep its output in a global variable?',
                {'leaks': True},
            )
        self._run(_GAINS, self._other)
        first = self._run(_GAINS)
        if not any(first):
            return Finding('pid.reset', 0.0, 'the output is always 0: there is nothing to remember')
        says, checks = [], 2
        leaks = _differ(first, self._run(_GAINS))
        if leaks:
            says.append(
                f'what one run leaves behind reaches into the next ({self._kept()}): is it kept in '
                'a global or class variable? Set it to 0 in __init__, as self.…'
            )
        if _differ(first, self._beside_another()):
            says.append('two PIDs at the same time share what they remember: keep it in self')
        if (again := self._reset_run(_GAINS)) is not None:
            checks += 1
            if not leaks and _differ(first, again):
                says.append(f'reset() does not forget {self._kept(reset=True)}')
        score = 1.0 - len(says) / checks
        message = '; '.join(says) or 'each run starts anew'
        return Finding('pid.reset', score, message, {'leaks': leaks})

    def _run(self, gains: Gains, sequence: Sequence | None = None) -> list[float]:
        return self._code.new_pid(*gains).acc_sequence((sequence or self._sequence).rows)

    def _reset_run(self, gains: Gains) -> list[float] | None:
        """Return the outputs of a PID that has been reset; None where it can't be."""
        pid = self._code.new_pid(*gains)
        pid.acc_sequence(self._other.rows)
        return pid.acc_sequence(self._sequence.rows) if pid.reset() else None

    def _beside_another(self) -> list[float]:
        one, other = self._code.new_pid(*_GAINS), self._code.new_pid(*_GAINS)
        outputs = []
        for mine, its in zip(self._sequence.rows, self._other.rows, strict=True):
            outputs.append(one.acc_calculate(*mine))
            other.acc_calculate(*its)
        return outputs

    def _kept(self, *, reset: bool = False) -> str:
        """Return what of a run is still there in the next one."""
        kept = []
        for name, gains in _ALONE.items():
            self._run(gains, self._other)
            first = self._run(gains)
            again = self._reset_run(gains) if reset else self._run(gains)
            if again is None or _differ(first, again):
                kept.append(name)
        return ' and '.join(kept) or 'the output'


def _differ(one: list[float], other: list[float]) -> bool:
    return bool(np.max(np.abs(np.subtract(one, other))) > _TOLERANCE)
