"""Judges each term of the PID on its own: the other two gains are zero.

Every common form is right. The integral can add an error, or the mean of two, with or without the
first, before or after it is used. The derivative can use the error or the measurement, with
or without a low-pass filter of first order; its first output is not judged. A positive constant
factor, such as a missing dt, is right and remarked upon: the gains absorb it. `pid.dt` judges it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.errors import UserError
from barc_sim.lab.check.diagnose_terms import (
    Trial,
    common_factor,
    diagnose,
    remark,
    rounding,
)
from barc_sim.lab.check.findings import Finding, judges
from barc_sim.lab.check.situations import TS, Sequence, wandering

if TYPE_CHECKING:
    from collections.abc import Callable
    from collections.abc import Sequence as SequenceOf

    from barc_sim.lab.check.code import JudgedCode
    from barc_sim.lab.check.equations import Floats
    from barc_sim.lab.check.findings import Judged

    Gains = tuple[float, float, float]

#: [m/s²] Size of a term's output: 50 times as much, with a missing dt, is still below 8.
_OUTPUT = 0.1
TOLERANCE = 1e-9  #: [m/s²]
_SUM = 1.0  #: [m/s] Greatest sum of errors, far below what a limited sum allows.
#: Factors to a whole term that are usual: with or without dt.
_FACTORS = (1.0, TS, 1.0 / TS, TS * TS)
_HALF = 0.5
_LARGE = 1e3  #: Factor to errors whose outputs are rounded to other numbers than 0.


@dataclass(frozen=True)
class Term:
    """A term of the PID, and how it is judged."""

    criterion: str
    name: str  #: P, I or D
    gains: tuple[float, ...]
    reach: float  #: amplitude of its output for an error of amplitude 1 and a gain of 1
    variants: Callable[[Sequence], list[Floats]]  #: the right outputs, for a gain of 1
    first: int = 0  #: the first output that is judged

    def only(self, gain: float) -> Gains:
        """Return gains that are zero except for this term's."""
        kp, ki, kd = (gain if name == self.name else 0.0 for name in 'PID')
        return kp, ki, kd


def _integral(sequence: Sequence) -> list[Floats]:
    area = np.cumsum(sequence.error) * TS
    first = area[0]
    mean = area - 0.5 * TS * sequence.error
    forms = [area, area - first, mean, mean - 0.5 * first, mean + 0.5 * first]
    return forms + [np.concatenate([[0.0], form[:-1]]) for form in forms]


def _derivative(sequence: Sequence) -> list[Floats]:
    return [
        np.diff(sequence.error, prepend=sequence.error[0]) / TS,
        -np.diff(sequence.measured, prepend=sequence.measured[0]) / TS,
    ]


TERMS = (
    Term('pid.proportional', 'P', (0.5, 30.0), 1.0, lambda sequence: [sequence.error]),
    Term('pid.integral', 'I', (0.5, 200.0), 0.6, _integral),
    Term('pid.derivative', 'D', (0.1, 3.0), 2.0 / TS, _derivative, first=1),
)


@np.errstate(all='ignore')
def judge_term(code: JudgedCode, term: Term, seed: int) -> Finding:
    """Return the finding for a term; its score is the share of right outputs, above one half."""
    try:
        trials = [_trial(code, term, gain, _sequence(term, gain, seed)) for gain in term.gains]
    except UserError as error:
        return Finding(term.criterion, 0.0, str(error))
    shares = [_share(trial, 1.0) for trial in trials]
    if min(shares) == 1.0:
        return Finding(term.criterion, 1.0, _right(term, trials), factor=1.0)
    if factor := common_factor(trials):
        hint = remark(term.name, factor)
        message = f'{_right(term, trials)}; {hint}, or choose gains that absorb it'
        return Finding(term.criterion, 1.0, message, factor=factor)
    message = (
        rounding(trials)
        or _rounded_to_zero(code, term, trials, seed)
        or _multiplied(code, term, seed)
        or diagnose(term.name, trials)
    )
    score = max(float(np.mean([_share(t, factor) for t in trials])) for factor in _FACTORS)
    # A smaller share is chance: outputs of a wrong term that happen to be right.
    return Finding(term.criterion, score if score > _HALF else 0.0, message)


@judges('pid.dt')
def judge_dt(findings: SequenceOf[Finding]) -> Judged:
    """Return the finding on the factors of the terms, from their findings."""
    wrong = [finding for finding in findings if finding.factor != 1.0]
    names = {term.criterion: term.name for term in TERMS}
    hints = [
        remark(names[finding.criterion], finding.factor)
        if finding.factor
        else f'{names[finding.criterion]} is not right'
        for finding in wrong
    ]
    right = 'each term has the factor of the formula, dt included'
    return 1.0 - len(wrong) / len(findings), '; '.join(hints) or right


@judges('pid.first_call')
def judge_first_call(code: JudgedCode, derivative: Finding, seed: int) -> Judged:
    """Return whether D is 0 at the first call, which has no error before it."""
    if derivative.factor is None:
        return 0.0, 'D is not right: see pid.derivative'
    term = TERMS[-1]
    gain = term.gains[0]
    sample = _sequence(term, gain, seed).rows[0]
    output = code.new_pid(*term.only(gain)).acc_calculate(*sample)
    if abs(output) <= TOLERANCE:
        return 1.0, 'D is 0 at the first call'
    return 0.0, (
        f'D is {output:.3g} m/s² at the first call, which has no error before it: start with '
        'e_before = None, and let D be 0 then'
    )


@np.errstate(all='ignore')
def ignores_gains(code: JudgedCode, seed: int) -> str:
    """Return a message if the outputs are the same for all gains, else an empty string."""
    rows = wandering(seed, 'gains', 1.0).rows
    try:
        outputs = [
            code.new_pid(*gains).acc_sequence(rows) for gains in ((1.0, 0.5, 0.1), (3.0, 2.0, 0.7))
        ]
    except UserError:
        return ''
    if outputs[0] != outputs[1] or not any(outputs[0]):
        return ''
    return (
        'the gains that PID gets have no effect: it uses numbers of its own. Store kp, ki and kd '
        'in __init__, and use these'
    )


def _sequence(term: Term, gain: float, seed: int) -> Sequence:
    sequence = wandering(seed, f'{term.criterion} {gain}', _OUTPUT / gain / term.reach)
    greatest = float(np.max(np.abs(np.cumsum(sequence.error))))
    return sequence.scaled(min(1.0, _SUM / greatest)) if term.name == 'I' else sequence


def _trial(code: JudgedCode, term: Term, gain: float, sequence: Sequence, kp: float = 0.0) -> Trial:
    """Return the outputs with the gain of one term, and kp beside it."""
    own, ki, kd = term.only(gain)
    outputs = np.array(code.new_pid(own or kp, ki, kd).acc_sequence(sequence.rows))
    return Trial(gain, sequence, outputs, term.variants(sequence), term.first)


def _right(term: Term, trials: list[Trial]) -> str:
    count = sum(trial.outputs.size for trial in trials)
    return (
        f'right in all {count} outputs, for gains of {" and ".join(f"{g:g}" for g in term.gains)}'
    )


def _rounded_to_zero(code: JudgedCode, term: Term, trials: list[Trial], seed: int) -> str:
    """Return a message if only large outputs differ from 0, and are rounded."""
    if any(np.any(trial.outputs) for trial in trials):
        return ''
    gain = term.gains[-1]
    try:
        return rounding([_trial(code, term, gain, _sequence(term, gain, seed).scaled(_LARGE))])
    except UserError:
        return ''


def _share(trial: Trial, factor: float) -> float:
    """Return the share of outputs that are right but for `factor`, for the best variant."""
    outputs = trial.outputs[trial.first :]
    expected = [factor * trial.gain * variant[trial.first :] for variant in trial.variants]
    if trial.first:
        filtered = [_low_passed(outputs, variant) for variant in expected]
        expected += [values for values in filtered if values is not None]
    return max(_agreement(outputs, values) for values in expected)


def _agreement(outputs: Floats, expected: Floats) -> float:
    """Return the share of right outputs among non-zero ones, times that among zeros."""
    right, nonzero = np.abs(outputs - expected) <= TOLERANCE, np.abs(expected) > TOLERANCE
    return float(np.mean(right[nonzero]) * (np.mean(right[~nonzero]) if not nonzero.all() else 1.0))


def _low_passed(outputs: Floats, raw: Floats) -> Floats | None:
    """Return `raw` after the low-pass filter that the first two outputs show, if there is one."""
    if outputs[0] == raw[1]:
        return None
    pole = (outputs[1] - raw[1]) / (outputs[0] - raw[1])
    if not 0.0 < pole < 1.0:
        return None
    values = [float(outputs[0])]
    for value in raw[1:]:
        values.append(pole * values[-1] + (1.0 - pole) * float(value))
    return np.array(values)


def _multiplied(code: JudgedCode, term: Term, seed: int) -> str:
    """Return a message if kp multiplies the other terms, too, else an empty string."""
    if term.name == 'P':
        return ''
    kp, gain = 2.0, term.gains[0]
    sequence = _sequence(term, gain, seed)
    try:
        alone, both = (_trial(code, term, gain, sequence, kp=each) for each in (0.0, kp))
    except UserError:
        return ''
    rest = both.outputs - kp * sequence.error
    expected = [kp * gain * variant for variant in both.variants]
    fits = any(np.allclose(rest[1:], values[1:], 0.0, TOLERANCE) for values in expected)
    if any(alone.outputs[1:]) or not fits:
        return ''
    return (
        f'kp multiplies the k{term.name.lower()} term, too: the gains are those of '
        'kp * e + ki * (sum of e * dt) + kd * (change of e) / dt'
    )
