"""Judges each term of the PID on its own: the other two gains are zero.

Every common form is right. The integral can add an error before or after it is used, or the mean
of two errors, with or without the first. The derivative can use the error or the measurement, with
or without a low-pass filter of first order; its first output is not judged.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.errors import UserError
from barc_sim.lab.check.diagnose_terms import (
    Trial,
    diagnose_derivative,
    diagnose_integral,
    diagnose_proportional,
)
from barc_sim.lab.check.findings import IGNORE_FLOAT_ERRORS, Finding
from barc_sim.lab.check.situations import TS, Sequence, wandering

if TYPE_CHECKING:
    from collections.abc import Callable

    from barc_sim.lab.check.code import JudgedCode
    from barc_sim.lab.check.equations import Floats

    Gains = tuple[float, float, float]

#: [m/s²] Size of a term's output: 50 times as much, with a missing dt, is still below 8.
_OUTPUT = 0.1
TOLERANCE = 1e-9  #: [m/s²]


@dataclass(frozen=True)
class Term:
    """A term of the PID, and how it is judged."""

    criterion: str
    position: int  #: of its gain in kp, ki, kd
    gains: tuple[float, ...]
    reach: float  #: amplitude of its output for an error of amplitude 1 and a gain of 1
    variants: Callable[[Sequence], list[Floats]]  #: the right outputs, for a gain of 1
    diagnose: Callable[[list[Trial]], str]  #: returns what is wrong
    first: int = 0  #: the first output that is judged

    def only(self, gain: float) -> Gains:
        """Return gains that are zero except for this term's."""
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
    Term('pid.proportional', 0, (0.5, 30.0), 1.0, _proportional, diagnose_proportional),
    Term('pid.integral', 1, (0.5, 200.0), 0.6, _integral, diagnose_integral),
    Term('pid.derivative', 2, (0.1, 3.0), 2.0 / TS, _derivative, diagnose_derivative, first=1),
)


@IGNORE_FLOAT_ERRORS
def judge_term(code: JudgedCode, term: Term, seed: int) -> Finding:
    """Return the finding for a term; its score is the share of right outputs."""
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
    message = _multiplied(code, term, seed) or term.diagnose(trials)
    return Finding(term.criterion, float(np.mean(shares)), message)


def _right(term: Term, trials: list[Trial]) -> str:
    count = sum(trial.outputs.size for trial in trials)
    return (
        f'right in all {count} outputs, for gains of {" and ".join(f"{g:g}" for g in term.gains)}'
    )


def _share(trial: Trial) -> float:
    """Return the share of right outputs, for the variant that fits best."""
    outputs = trial.outputs[trial.first :]
    expected = [trial.gain * variant[trial.first :] for variant in trial.variants]
    expected += (
        [
            filtered
            for variant in expected
            if (filtered := _low_passed(outputs, variant)) is not None
        ]
        if trial.first
        else []
    )
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
    expected = [kp * gain * variant for variant in term.variants(sequence)]
    fits = any(np.allclose(rest[1:], values[1:], 0.0, TOLERANCE) for values in expected)
    if any(alone[1:]) or not fits:
        return ''
    name = 'ki' if term.position == 1 else 'kd'
    return (
        f'kp multiplies the {name} term, too: the gains are those of '
        'kp * e + ki * (sum of e * dt) + kd * (change of e) / dt'
    )
