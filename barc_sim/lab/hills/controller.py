"""Judges a `PID`: each term alone, and its time step.

Every common form of a term is right. The integral can add an error, or the mean of two, with or
without the first, before or after it is used. The derivative can use the error or the measurement,
with or without a low-pass filter of first order; its first output is not judged. A positive
constant factor, such as a missing dt, is right and remarked upon: the gains absorb it. `pid.dt`
judges it.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.errors import UserError
from barc_sim.lab.check.code import Finding, judges
from barc_sim.lab.check.laws import Law, Mistake, read
from barc_sim.lab.hills.loop import NOT_A_CAR
from barc_sim.lab.hills.memory import RANDOM, TOLERANCE, judge_reset, judge_windup, wandering
from barc_sim.lab.hills.model import TS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from barc_sim.lab.check.code import Judged, JudgedCode, Sample
    from barc_sim.lab.check.laws import Floats

    Gains = tuple[float, float, float]  # kp, ki, kd


def _total(values: Floats) -> Floats:
    """Return the sums up to each call."""
    return np.cumsum(values, axis=-1)


def _before(values: Floats, calls: int = 1) -> Floats:
    """Return the values some calls before; the first value before the first call."""
    earlier: Floats = values[:, np.maximum(np.arange(values.shape[1]) - calls, 0)]
    return earlier


def _delayed(values: Floats, calls: int = 1) -> Floats:
    """Return the values some calls before; 0 before the first call."""
    return np.where(np.arange(values.shape[1]) < calls, 0.0, _before(values, calls))


def _window(values: Floats, calls: int) -> Floats:
    """Return the sums of the last values."""
    return _total(values) - _delayed(_total(values), calls)


def _bounded_total(values: Floats, low: Floats, high: Floats) -> Floats:
    """Return the sums up to each call, each kept within its bounds."""
    sums = np.zeros_like(values)
    total = np.zeros(len(values))
    for k, column in enumerate(values.T):
        total = np.clip(total + column, low.ravel(), high.ravel())
        sums[:, k] = total
    return sums


#: The integral adds each error, or the mean of two; the first one in full, half or not at all.
_AREAS = (
    'total(e) * dt',
    '(total(e) - e[:, :1]) * dt',
    '(total(e) - 0.5 * e) * dt',
    '(total(e) - 0.5 * e - 0.5 * e[:, :1]) * dt',
    '(total(e) - 0.5 * e + 0.5 * e[:, :1]) * dt',
)
PID_LAW = Law(
    *read(Path(__file__).with_name('pid.txt')),
    alternatives={
        # The sum is used after, or before the error of this call is added.
        'I': tuple({'area': form} for area in _AREAS for form in (area, f'delayed({area})')),
        'D': ({'change': 'e - before(e)'}, {'change': 'before(measured) - measured'}),
    },
    functions={
        'total': _total,
        'before': _before,
        'delayed': _delayed,
        'window': _window,
        'bounded_total': _bounded_total,
    },
)


def _mistakes(*topics: str) -> tuple[Mistake, ...]:
    return tuple(each for topic in topics for each in PID_LAW.mistakes if each.topic[0] == topic)


#: By term, the law with the mistakes in that term, then those in the error.
TERM_LAWS = {name: replace(PID_LAW, mistakes=_mistakes(name, 'E')) for name in 'PID'}
LABELS = {
    'pid.proportional': 'PID: proportional term',
    'pid.integral': 'PID: integral term',
    'pid.derivative': 'PID: derivative term',
    'pid.dt': 'PID: the time step',
    'pid.first_call': 'PID: the first call',
    'pid.windup': 'PID: integral at the limit',
    'pid.reset': 'PID: fresh start of a new run',
}


def judge_controller(code: JudgedCode, seed: int) -> Iterator[Finding]:
    """Yield a finding for each criterion `pid.…`."""
    reset = judge_reset(code, seed)
    terms = _judge_terms(code, seed)
    others = (_judge_dt(terms), _judge_first_call(code, terms[-1], seed), judge_windup(code))
    if terms[1].factor is None and not others[-1].passed:
        # What follows from a mistake in the integral is not taken off again.
        others = (*others[:-1], replace(others[-1], score=max(others[-1].score, terms[1].score)))
    for finding in (*terms, *others):
        # Randomness comes first in the message: it changes every other result.
        random = not finding.passed and reset.message.startswith(RANDOM)
        message = f'{reset.message}. So: {finding.message}' if random else finding.message
        yield replace(finding, message=message)
    yield reset


class Term(NamedTuple):
    """A term of the PID, and how it is judged."""

    criterion: str
    name: str  #: P, I or D
    formula: str
    gains: tuple[float, float]
    reach: float  #: amplitude of its output for an error of amplitude 1 and a gain of 1
    max_sum: float = inf  #: [m/s] of the errors
    first: int = 0  #: the first output that is judged

    def only(self, gain: float, kp: float = 0.0) -> Gains:
        """Return gains that are zero except for this term's, and `kp`."""
        own, ki, kd = (gain if name == self.name else 0.0 for name in 'PID')
        return own or kp, ki, kd

    def sequence(self, gain: float, seed: int, output: float = 0.1) -> list[Sample]:
        """Return calls that make outputs of the size `output` [m/s²].

        The usual one is small: 50 times as much, with a missing dt, is still below 8.
        """
        amplitude = output / gain / self.reach
        return wandering(seed, f'{self.criterion} {gain}', amplitude, self.max_sum * output / 0.1)


TERMS = (
    Term('pid.proportional', 'P', 'kp * e', (0.5, 30.0), 1.0),
    # The sum of errors is far below what a limited sum allows.
    Term('pid.integral', 'I', 'ki * (sum of e * dt)', (0.5, 200.0), 0.6, max_sum=1.0),
    Term('pid.derivative', 'D', 'kd * (e - e_before) / dt', (0.1, 3.0), 2.0 / TS, first=1),
)


@dataclass(eq=False)
class Trials:
    """The outputs of a term: a row for each of its gains, a column for each call."""

    term: Term
    outputs: Floats
    inputs: dict[str, Floats]  #: of the law

    @property
    def expected(self) -> list[Floats]:
        """The right outputs, by each form of the term."""
        return TERM_LAWS[self.term.name].right(self.inputs, self.term.name)

    def by(self, mistake: Mistake) -> list[Floats]:
        """Return the outputs with a mistake, by each form of the term."""
        return TERM_LAWS[self.term.name].right(self.inputs, self.term.name, mistake.formulas)

    def ratio(self, got: Floats, expected: Floats) -> float:
        """Return the constant factor between outputs; 0 if there is none."""
        got, expected = (values[:, self.term.first :] for values in (got, expected))
        ratio = float(np.vdot(got, expected) / np.vdot(expected, expected))
        fits = np.abs(got - ratio * expected).max() <= _RELATIVE * np.abs(got).max()
        return ratio if fits else 0.0

    def proportional(self, got: Floats, expected: Floats) -> bool:
        """Return whether outputs are others, up to a positive factor."""
        if np.any(got[:, self.term.first :]):
            return self.ratio(got, expected) > 0.0
        return not np.any(expected)

    def factor(self) -> float:
        """Return the factor of a right term, which is positive; 0 if the term is wrong."""
        factor = max(self.ratio(self.outputs, form) for form in self.expected)
        if factor <= 0.0 and self.term.first:
            usual = (value for value in _FACTORS if self.share(value) == 1.0)
            factor = next(usual, 0.0)
        return 1.0 if abs(factor - 1.0) <= _RELATIVE else max(factor, 0.0)

    def share(self, factor: float) -> float:
        """Return the share of outputs that are right but for `factor`, by the best form."""
        shares = []
        for form in self.expected:
            raw = (factor * form)[:, self.term.first :]
            got = self.outputs[:, self.term.first :]
            tried = [raw, _low_passed(got, raw)] if self.term.first else [raw]
            shares += [np.mean(np.abs(got - values) <= TOLERANCE, axis=1) for values in tried]
        return float(np.mean(np.max(shares, axis=0)))


_RELATIVE = 1e-7
#: Factors to a whole term that are usual: with or without dt.
_FACTORS = (1.0, TS, 1.0 / TS, TS * TS)
_HALF = 0.5


def _low_passed(outputs: Floats, raw: Floats) -> Floats:
    """Return `raw` after the low-pass filter that the first two outputs show; NaN without one."""
    pole = (outputs[:, 1] - raw[:, 1]) / (outputs[:, 0] - raw[:, 1])
    pole[~((pole > 0.0) & (pole < 1.0))] = np.nan
    values: Floats = outputs.copy()
    for k in range(1, values.shape[1]):
        values[:, k] = pole * values[:, k - 1] + (1.0 - pole) * raw[:, k]
    return values


def _trials(
    code: JudgedCode, term: Term, seed: int, output: float = 0.1, kp: float = 0.0
) -> Trials:
    """Return the outputs of a term alone, or what it adds to P with the gain `kp`."""
    sequences = [term.sequence(gain, seed, output) for gain in term.gains]
    gains = [term.only(gain, kp) for gain in term.gains]
    outputs = _outputs(code, gains, sequences)
    if kp:
        outputs -= _outputs(code, [term.only(0.0, kp)] * len(gains), sequences)
    reference, measured, _ = np.array(sequences).transpose(2, 0, 1)
    inputs = {
        'reference': reference,
        'measured': measured,
        'dt': np.array(TS),
        'low': outputs.min(axis=1, keepdims=True),
        'high': outputs.max(axis=1, keepdims=True),
        **dict(zip(('kp', 'ki', 'kd'), np.array(gains).T[..., np.newaxis], strict=True)),
    }
    return Trials(term, outputs, inputs)


def _outputs(code: JudgedCode, gains: Sequence[Gains], sequences: Sequence[list[Sample]]) -> Floats:
    pairs = zip(gains, sequences, strict=True)
    return np.array([code.new_pid(*each).acc_sequence(sequence) for each, sequence in pairs])


def wrong_terms(findings: Sequence[Finding]) -> str:
    """Return the letters of the terms that are there, but wrong."""
    scores = {each.criterion: each.score for each in findings}
    return ''.join(term.name for term in TERMS if 0.0 < scores[term.criterion] < 1.0)


@np.errstate(all='ignore')
def _judge_terms(code: JudgedCode, seed: int) -> list[Finding]:
    """Return the finding for each term.

    A term that is there, with a known mistake, loses a half; the same mistake in several terms
    counts once. Another one has the share of right outputs, above one half.
    """
    if ignored := ignores_gains(code, seed):
        return [Finding(term.criterion, *ignored[term.name]) for term in TERMS]
    tried: dict[str, Trials] = {}
    findings: dict[str, Finding] = {}
    for term in TERMS:
        try:
            tried[term.name] = trials = _trials(code, term, seed)
        except UserError as error:
            findings[term.name] = Finding(term.criterion, 0.0, str(error))
            continue
        if factor := trials.factor():
            gains = ' and '.join(f'{gain:g}' for gain in term.gains)
            message = f'right in all {trials.outputs.size} outputs, for gains of {gains}'
            if factor != 1.0:
                message += f'; {_remark(term.name, factor)}, or choose gains that absorb it'
            findings[term.name] = Finding(term.criterion, 1.0, message, factor=factor)
    common = _in_the_error(tried)
    wrong = {name: trials for name, trials in tried.items() if name not in findings}
    placed: dict[str, str] = {}  # one mistake has one line
    causes = {name: _cause(code, each, seed, common, placed) for name, each in wrong.items()}
    times = Counter(kind for _, kind in causes.values())
    for name, (message, kind) in causes.items():
        score = max(map(tried[name].share, _FACTORS))
        # A smaller share is chance: outputs of a wrong term that happen to be right.
        score = score if score > _HALF else 0.0
        if kind:
            score = 1.0 - _HALF / times[kind]
        findings[name] = Finding(tried[name].term.criterion, score, message)
    return [findings[term.name] for term in TERMS]


def _in_the_error(tried: Mapping[str, Trials]) -> Mistake | None:
    """Return the mistake in the error that explains all wrong terms, but those that are absent."""
    outputs = {name: trials.outputs for name, trials in tried.items() if trials.outputs.any()}
    for mistake in _mistakes('E') if len(outputs) > 1 else ():
        explained = (
            any(tried[name].proportional(got, values) for values in tried[name].by(mistake))
            for name, got in outputs.items()
        )
        if all(explained) and not all(tried[name].factor() for name in outputs):
            return mistake
    return None


def _cause(
    code: JudgedCode, trials: Trials, seed: int, common: Mistake | None, placed: dict[str, str]
) -> tuple[str, str]:
    """Return why a term is wrong, and the kind of mistake; empty where the term is not there.

    That is rounding, the mistake in it, or its largest error.
    """
    term, large = trials.term, trials
    if not trials.outputs.any():
        try:
            # Only large outputs are rounded to other numbers than 0; kp can multiply the term.
            large = _trials(code, term, seed, output=100.0)
            trials = trials if term.name == 'P' else _trials(code, term, seed, kp=3.0)
        except UserError:
            pass
    cause, hint = common if trials.outputs.any() else None, _rounding(large.outputs)
    if not cause and not hint:
        cause = (
            TERM_LAWS[term.name]
            .explain(trials.inputs, {term.name: trials.outputs}, [term.name], trials.proportional)
            .get(term.name)
        )
    message = hint or (cause.sentence if cause else _largest_error(trials))
    kind = hint or (cause.kind if cause and trials.outputs.any() else '')
    placed[message] = placed.get(message) or _placed(code, trials, cause)
    return placed[message] + message, kind


def _placed(code: JudgedCode, trials: Trials, cause: Mistake | None) -> str:
    """Return the file and line that compute a wrong term, with a colon; empty if not known."""
    inputs, got, expected = trials.inputs, trials.outputs, trials.expected[0]
    k = (
        int(np.argmax(np.abs(got - expected)[0, trials.term.first :] > TOLERANCE))
        + trials.term.first
    )
    reference, measured = (inputs[name][0, : k + 1].tolist() for name in ('reference', 'measured'))
    rows = [(r, v, TS) for r, v in zip(reference, measured, strict=True)]
    gains = [float(inputs[name].ravel()[0]) for name in ('kp', 'ki', 'kd')]

    try:
        (*_, output) = code.new_pid(*gains).acc_sequence(rows)
        pid = code.new_pid(*gains)
        pid.acc_sequence(rows[:-1])
    except UserError:
        return ''
    wrong = [got[0, k], output, *(PID_LAW.changed(inputs, cause, (0, k)) if cause else ())]
    others = [*rows[-1], output - got[0, k]]  # P, where that is added
    place = code.line_of('steps', (pid.number, rows[-1:]), wrong, others)
    return f'{place}: ' if place else ''


def _rounding(outputs: Floats) -> str:
    """Return a sentence if the outputs are rounded, else an empty string."""
    for digits in range(5):
        if outputs.any() and np.array_equal(outputs, np.round(outputs, digits)):
            return (
                f'the outputs are rounded to {digits} digits: return them as they are'
                if digits
                else 'the outputs are whole numbers: does int(…) or // cut them? Return them as '
                'they are'
            )
    return ''


def _largest_error(trials: Trials) -> str:
    """Return a sentence on the call with the largest error."""
    term, got, expected = trials.term, trials.outputs[0], trials.expected[0][0]
    error = (trials.inputs['reference'] - trials.inputs['measured'])[0]
    k = term.first + int(np.argmax(np.abs(got - expected)[term.first :]))
    before = f', after {error[k - 1]:.6g}' if k else ''
    return (
        f'{term.name} is not {term.formula}: with a gain of {term.gains[0]:g}, call {k + 1}, '
        f'e = {error[k]:.6g} m/s{before}, gave {got[k]:.6g}, expected about {expected[k]:.6g} m/s²'
    )


def _remark(term: str, factor: float) -> str:
    """Return the remark on a term that is right up to a `factor`, which the gains absorb."""
    usual: Mapping[str, Mapping[float, str]] = {
        'P': {TS: 'P is multiplied by dt: it is kp * e'},
        'I': {1.0 / TS: 'I has no dt: add up ki * e * dt, with dt = 0.02 s'},
        'D': {
            TS: f'D has no dt: divide the change of e by dt = {TS:g} s',
            TS * TS: f'D is multiplied by dt: divide the change of e by dt = {TS:g} s',
        },
    }
    for value, sentence in usual[term].items():
        if abs(factor - value) <= _RELATIVE * value:
            return sentence
    return {
        'P': f'P is multiplied by {factor:g}: it is kp * e',
        'I': f'I uses dt = {factor * TS:g} s: PID is called every {TS:g} s, ki * (sum of e * dt)',
        'D': (
            f'D uses dt = {TS / factor:g} s: PID is called every {TS:g} s, kd * (e - e_before) / dt'
        ),
    }[term]


@np.errstate(all='ignore')
def ignores_gains(code: JudgedCode, seed: int) -> dict[str, tuple[float, str]]:
    """Return score and message of each term if outputs are the same for all gains, else nothing.

    A term that is there, with a gain of its own, loses a half.
    """
    rows = wandering(seed, 'gains', 0.01)
    try:
        one, other = (
            code.new_pid(*gains).acc_sequence(rows) for gains in ((1.0, 0.5, 0.1), (3.0, 2.0, 0.7))
        )
    except UserError:
        return {}
    if one != other or not any(one):
        return {}
    error = np.array([[reference - measured for reference, measured, _ in rows]])
    terms = np.concatenate([error, _total(error) * TS, (error - _before(error)) / TS]).T[1:]
    outputs = np.array(one[1:])
    own, *_ = np.linalg.lstsq(terms, outputs)
    fits = np.abs(terms @ own - outputs).max() <= _RELATIVE * min(np.abs(outputs).max(), NOT_A_CAR)
    message = (
        'the gains that PID gets have no effect: it uses numbers of its own. Store kp, ki and kd '
        'in __init__, and use these'
    )
    there = fits & (np.abs(own) > _RELATIVE)
    return {name: (_HALF * bool(each), message) for name, each in zip('PID', there, strict=True)}


@judges('pid.dt')
def _judge_dt(findings: Sequence[Finding]) -> Judged:
    """Return the finding on the factors of the terms, from their findings."""
    names = {term.criterion: term.name for term in TERMS}
    wrong = {names[each.criterion]: each.factor for each in findings if each.factor != 1.0}
    # What follows from a mistake in a term is not taken off again.
    scores = [each.factor == 1.0 if each.factor else each.score for each in findings]
    hints = [
        _remark(name, factor) if factor else f'{name} is not right'
        for name, factor in wrong.items()
    ]
    right = 'each term has the factor of the formula, dt included'
    return float(np.mean(scores)), '; '.join(hints) or right


@judges('pid.first_call')
def _judge_first_call(code: JudgedCode, derivative: Finding, seed: int) -> Judged:
    """Return whether D is 0 at the first call, which has no error before it."""
    if derivative.factor is None:
        return derivative.score, 'D is not right: see pid.derivative'
    term = TERMS[-1]
    gain = term.gains[0]
    pid = code.new_pid(*term.only(gain))
    output = pid.acc_calculate(*term.sequence(gain, seed)[0])
    if abs(output) <= TOLERANCE:
        return 1.0, 'D is 0 at the first call'
    return 0.0, (
        f'D is {output:.3g} m/s² at the first call, which has no error before it: start with '
        'e_before = None, and let D be 0 then'
    )
