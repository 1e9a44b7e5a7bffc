"""Judges the PID's terms, each on its own: the other two gains are zero.

Whatever is sensible is right. The integral may count an error before or after it answers, or the
mean of two, and may or may not count the first; the derivative may be that of the error or of the
measurement, through a low-pass of first order or not, and its first answer may be anything.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.errors import UserError
from barc_sim.lab.check.finding import WHATEVER_COMES, Finding
from barc_sim.lab.check.ratios import Trial, derivative_says, integral_says, proportional_says
from barc_sim.lab.check.sequences import Sequence, wandering
from barc_sim.lab.check.situations import TS

if TYPE_CHECKING:
    from collections.abc import Callable

    from barc_sim.lab.check.code import Code
    from barc_sim.lab.check.equations import Floats

    Gains = tuple[float, float, float]

#: [m/s²] What is asked of a term: fifty times as much, where dt is missing, is still below 8.
_OUTPUT = 0.1
TOLERANCE = 1e-9  #: [m/s²]


@dataclass(frozen=True)
class Term:
    """How a term is judged."""

    criterion: str
    position: int  #: of its gain in kp, ki, kd
    gains: tuple[float, ...]
    reach: float  #: the amplitude of its output for an error of amplitude 1 and a gain of 1
    variants: Callable[[Sequence], list[Floats]]  #: what is right, for a gain of 1
    says: Callable[[list[Trial]], str]  #: what is wrong
    first: int = 0  #: the first answer that counts

    def only(self, gain: float) -> Gains:
        """Return gains of which this term's alone is not zero."""
        kp, ki, kd = (gain if i == self.position else 0.0 for i in range(3))
        return kp, ki, kd


def _proportional(sequence: Sequence) -> list[Floats]:
    return [sequence.error]


def _integral(sequence: Sequence) -> list[Floats]:
    e, area = sequence.error, np.cumsum(sequence.error) * TS
    before = np.concatenate([[0.0], area[:-1]])
    mean = 0.5 * (before + area)
    return [
        area,
        before,
        area - area[0],
        before - np.minimum(np.arange(e.size), 1) * area[0],
        mean,
        mean - 0.5 * area[0],
        mean + 0.5 * area[0],
    ]


def _derivative(sequence: Sequence) -> list[Floats]:
    return [
        np.diff(sequence.error, prepend=sequence.error[0]) / TS,
        -np.diff(sequence.measured, prepend=sequence.measured[0]) / TS,
    ]


TERMS = (
    Term('pid.proportional', 0, (0.5, 30.0), 1.0, _proportional, proportional_says),
    Term('pid.integral', 1, (0.5, 200.0), 0.6, _integral, integral_says),
    Term('pid.derivative', 2, (0.1, 3.0), 2.0 / TS, _derivative, derivative_says, first=1),
)


@WHATEVER_COMES
def judge_term(code: Code, term: Term, seed: int) -> Finding:
    """Return what is found of a term: its score is the share of right answers."""
    trials = []
    for gain in term.gains:
        sequence = wandering(seed, f'{term.criterion} {gain}', _OUTPUT / gain / term.reach)
        try:
            outputs = np.array(code.new_pid(*term.only(gain)).acc_sequence(sequence.rows))
        except UserError as error:
            return Finding(term.criterion, 0.0, str(error))
        variants = term.variants(sequence)
        trials.append(Trial(gain, sequence, outputs, variants, term.first))
    shares = [_share(trial) for trial in trials]
    if min(shares) == 1.0:
        return Finding(term.criterion, 1.0, _right(term, trials))
    message = _multiplied(code, term, seed) or term.says(trials)
    return Finding(term.criterion, float(np.mean(shares)), message)


def _right(term: Term, trials: list[Trial]) -> str:
    count = sum(trial.outputs.size for trial in trials)
    return (
        f'right in all {count} answers, for gains of {" and ".join(f"{g:g}" for g in term.gains)}'
    )


def _share(trial: Trial) -> float:
    """Return the share of right answers, by the variant that fits best."""
    outputs = trial.outputs[trial.first :]
    wanted = [trial.gain * variant[trial.first :] for variant in trial.variants]
    wanted += (
        [filtered for variant in wanted if (filtered := _low_passed(outputs, variant)) is not None]
        if trial.first
        else []
    )
    return max(_agreement(outputs, values) for values in wanted)


def _agreement(outputs: Floats, wanted: Floats) -> float:
    """Return the share of right answers where there is one to give, times that of right zeros."""
    right, asked = np.abs(outputs - wanted) <= TOLERANCE, np.abs(wanted) > TOLERANCE
    return float(np.mean(right[asked]) * (np.mean(right[~asked]) if not asked.all() else 1.0))


def _low_passed(outputs: Floats, raw: Floats) -> Floats | None:
    """Return `raw` through the low-pass that the first two answers tell of, if there is one."""
    if outputs[0] == raw[1]:
        return None
    pole = (outputs[1] - raw[1]) / (outputs[0] - raw[1])
    if not 0.0 < pole < 1.0:
        return None
    values = [float(outputs[0])]
    for value in raw[1:]:
        values.append(pole * values[-1] + (1.0 - pole) * float(value))
    return np.array(values)


def _multiplied(code: Code, term: Term, seed: int) -> str:
    """Return what to say where kp multiplies the other terms, too; or nothing."""
    if not term.position:
        return ''
    kp, gain = 2.0, term.gains[0]
    sequence = wandering(seed, term.criterion, _OUTPUT / gain / term.reach)
    _, ki, kd = term.only(gain)
    try:
        alone = code.new_pid(*term.only(gain)).acc_sequence(sequence.rows)
        outputs = np.array(code.new_pid(kp, ki, kd).acc_sequence(sequence.rows))
    except UserError:
        return ''
    rest = outputs - kp * sequence.error
    wanted = [kp * gain * variant for variant in term.variants(sequence)]
    fits = any(np.allclose(rest[1:], values[1:], 0.0, TOLERANCE) for values in wanted)
    if any(alone[1:]) or not fits:
        return ''
    name = 'ki' if term.position == 1 else 'kd'
    return (
        f'kp multiplies the {name} term, too: the gains are those of '
        'kp * e + ki * (sum of e * dt) + kd * (change of e) / dt'
    )
