"""Judges what a PID remembers: its past within a run, and nothing of another run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barc_sim.errors import UserError
from barc_sim.lab.check.finding import WHATEVER_COMES, Finding
from barc_sim.lab.check.sequences import Sequence, constant, wandering
from barc_sim.lab.check.situations import TS

if TYPE_CHECKING:
    from barc_sim.lab.check.code import Code
    from barc_sim.lab.check.stretches import Gains

_GAINS = (1.0, 2.0, 0.01)
_ALONE = {'the integral': (0.0, 2.0, 0.0), 'the last error': (0.0, 0.0, 0.01)}
_AMPLITUDE = 0.3  #: [m/s]
_TOLERANCE = 1e-9  #: [m/s²]


@WHATEVER_COMES
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
            return self._unsteady(', with kp alone')
        self._run(_GAINS, self._other)
        first = self._run(_GAINS)
        if not _differ(first, self._second_half()):
            return Finding(
                'pid.reset', 0.0, 'PID remembers nothing: I and D are made of the errors before'
            )
        says, checks = [], 2
        leaks = _differ(first, self._run(_GAINS))
        if leaks and not (kept := self._kept()):
            return self._unsteady('')
        if leaks:
            says.append(
                f'what one run leaves behind reaches into the next ({kept}): is it kept in a '
                'global or class variable? Set it to 0 in __init__, as self.…'
            )
        if _differ(first, self._beside_another()):
            says.append('two PIDs at the same time share what they remember: keep it in self')
        if (again := self._reset_run(_GAINS)) is not None:
            checks += 1
            if not leaks and _differ(first, again):
                says.append(f'reset() does not forget {self._not_reset()}')
        score = 1.0 - len(says) / checks
        message = '; '.join(says) or 'each run starts anew'
        return Finding('pid.reset', score, message, {'leaks': leaks})

    def _run(self, gains: Gains, sequence: Sequence | None = None) -> list[float]:
        return self._code.new_pid(*gains).acc_sequence((sequence or self._sequence).rows)

    def _second_half(self) -> list[float]:
        """Return the outputs of a PID that goes on from another sequence."""
        pid = self._code.new_pid(*_GAINS)
        pid.acc_sequence(self._other.rows)
        return pid.acc_sequence(self._sequence.rows)

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

    def _unsteady(self, when: str) -> Finding:
        return Finding(
            'pid.reset',
            0.0,
            f'the same speeds give different outputs{when}: is there anything random in PID, or a '
            f"clock? A call comes every {TS:g} s of the car's time",
            {'leaks': True},
        )

    def _kept(self) -> str:
        """Return what of a run a fresh PID still has; nothing where its outputs differ without."""
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
        """Return what of a run a PID still has when it has been reset."""
        kept = [
            name
            for name, gains in _ALONE.items()
            if (again := self._reset_run(gains)) is None or _differ(self._run(gains), again)
        ]
        return ' and '.join(kept) or 'its output'


def _differ(one: list[float], other: list[float]) -> bool:
    return not np.allclose(one, other, rtol=0.0, atol=_TOLERANCE)
