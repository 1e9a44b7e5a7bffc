"""Finds why a term of the PID is wrong, from the factor between its outputs and the right ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.lab.check.situations import TS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from barc_sim.lab.check.equations import Floats
    from barc_sim.lab.check.situations import Sequence

_RELATIVE = 1e-7
_WIDEST = 60  #: values of a window
_MOST_DIGITS = 4
#: What else can make a term 0 at all times.
_MEMORY = {
    'P': '',
    'I': ', and is each error added to the sum',
    'D': ', and is the error of the last call replaced only after D has used it',
}


class Trial(NamedTuple):
    """The outputs of a term with one gain."""

    gain: float
    sequence: Sequence
    outputs: Floats
    variants: list[Floats]  #: the right outputs, for a gain of 1
    first: int  #: the first output that is judged

    def ratio(self, shapes: Iterable[Floats]) -> float | None:
        """Return the constant factor between the outputs and one of `shapes`; None if none fits."""
        outputs = self.outputs[self.first :]
        for shape in (values[self.first :] for values in shapes):
            ratio = float(outputs @ shape / (shape @ shape))
            size = np.max(np.abs(outputs), initial=0.0)
            if np.max(np.abs(outputs - ratio * shape)) <= _RELATIVE * size:
                return ratio
        return None


def diagnose_proportional(trials: list[Trial]) -> str:
    """Return the cause of a wrong proportional term."""
    ratios = [trial.ratio(trial.variants) for trial in trials]
    if all(_is(ratio, -trial.gain) for ratio, trial in zip(ratios, trials, strict=True)):
        return 'P has the wrong sign: the error is speed_reference - speed_current'
    if hint := _diagnose_gain('kp', 'P', ratios, trials):
        return hint
    others: dict[str, Callable[[Trial], Floats]] = {
        'the outputs of all calls are added up: the output is P + I + D of this call alone': (
            lambda t: np.cumsum(t.sequence.error)
        ),
        'P uses the last error, not this one': (
            lambda t: np.concatenate([[0.0], t.sequence.error[:-1]])
        ),
        'P has no sign: do not use abs on the error': lambda t: np.abs(t.sequence.error),
        'P uses the speed alone: the error is speed_reference - speed_current': (
            lambda t: t.sequence.measured
        ),
        'P uses the reference alone: the error is speed_reference - speed_current': (
            lambda t: t.sequence.reference
        ),
    }
    for hint, shape in others.items():
        if all(trial.ratio([shape(trial)]) for trial in trials):
            return hint
    return _example('P', 'kp * e', trials[0])


def diagnose_integral(trials: list[Trial]) -> str:
    """Return the cause of a wrong integral term."""
    ratios = [trial.ratio(trial.variants) for trial in trials]
    if hint := _diagnose_gain('ki', 'I', ratios, trials):
        return hint
    if _factor_below_zero(ratios, trials):
        return 'I has the wrong sign: it adds up ki * (speed_reference - speed_current) * dt'
    others: dict[str, Callable[[Trial], list[Floats]]] = {
        'I has no memory: the errors are not added up, or the sum is lost between calls': (
            lambda t: [t.sequence.error]
        ),
        'I has no sign: do not use abs on the error': lambda t: [np.abs(v) for v in t.variants],
    }
    others |= {
        f'I adds up the last {width} errors only: the integral adds up all of them': (
            lambda t, width=width: [_window(t.sequence.error, width)]  # type: ignore[misc]
        )
        for width in range(2, _WIDEST)
    }
    for hint, shapes in others.items():
        if all(t.ratio(shapes(t)) for t in trials):
            return hint
    if all(
        np.abs(t.outputs[60:] / (t.outputs[60] or 1.0) - 1.0).max() <= _RELATIVE for t in trials
    ):
        return 'I stops growing after a while: is the limit of the sum too small?'
    return _example('I', 'ki * (sum of e * dt)', trials[0])


def diagnose_derivative(trials: list[Trial]) -> str:
    """Return the cause of a wrong derivative term."""
    ratios = [trial.ratio(trial.variants) for trial in trials]
    if hint := _diagnose_gain('kd', 'D', ratios, trials):
        return hint
    if _factor_below_zero(ratios, trials):
        return (
            'D has the wrong sign: it is kd * (e - e_before) / dt, or with the measured speed '
            '-kd * (v - v_before) / dt'
        )
    forgets = all(
        t.ratio([t.sequence.error, t.sequence.error - t.sequence.error[0], t.sequence.measured])
        for t in trials
    )
    if forgets:
        return 'D does not store the error of the last call: set e_before at the end of each call'
    for width in range(2, _WIDEST):
        if all(t.ratio([_change(t.sequence.error, width)]) for t in trials):
            return (
                f'D is the change over {width} calls: it is the change since the last call, '
                'kd * (e - e_before) / dt'
            )
    return _example('D', 'kd * (e - e_before) / dt', trials[0])


def remark(term: str, factor: float) -> str:
    """Return the remark on a term that is right up to a `factor`, which the gains absorb."""
    known = {
        'P': {TS: 'P is multiplied by dt: it is kp * e'},
        'I': {1.0 / TS: 'I has no dt: add up ki * e * dt, with dt = 0.02 s'},
        'D': {
            TS: f'D has no dt: divide the change of e by dt = {TS:g} s',
            TS * TS: f'D is multiplied by dt: divide the change of e by dt = {TS:g} s',
        },
    }
    other = {
        'P': f'P is multiplied by {factor:g}: it is kp * e',
        'I': f'I uses dt = {factor * TS:g} s: PID is called every {TS:g} s, ki * (sum of e * dt)',
        'D': (
            f'D uses dt = {TS / factor:g} s: PID is called every {TS:g} s, kd * (e - e_before) / dt'
        ),
    }
    return next((text for value, text in known[term].items() if _is(factor, value)), other[term])


def common_factor(trials: list[Trial]) -> float | None:
    """Return the factor of a term's outputs, if it is the same for all gains and positive."""
    factor = _common([_factor(trial.ratio(trial.variants), trial) for trial in trials])
    return factor if factor and factor > 0.0 else None


def rounding(trials: list[Trial]) -> str:
    """Return a sentence if the outputs are rounded, else an empty string."""
    outputs = np.concatenate([trial.outputs for trial in trials])
    for digits in range(_MOST_DIGITS):
        if np.any(outputs) and np.array_equal(outputs, np.round(outputs, digits)):
            if digits:
                return f'the outputs are rounded to {digits} digits: return them as they are'
            return (
                'the outputs are whole numbers: does int(…) or // cut them? Return them as they are'
            )
    return ''


def _factor(ratio: float | None, trial: Trial) -> float | None:
    return ratio / trial.gain if ratio else None


def _factor_below_zero(ratios: list[float | None], trials: list[Trial]) -> bool:
    factor = _common([_factor(r, t) for r, t in zip(ratios, trials, strict=True)])
    return factor is not None and factor < 0.0


def _window(values: Floats, width: int) -> Floats:
    """Return the sums of the last `width` values."""
    sums = np.cumsum(values)
    summed: Floats = sums - np.concatenate([np.zeros(width), sums[:-width]])
    return summed


def _change(values: Floats, width: int) -> Floats:
    """Return the changes over `width` values."""
    changed: Floats = values - np.concatenate([np.full(width, values[0]), values[:-width]])
    return changed


def _diagnose_gain(name: str, term: str, ratios: list[float | None], trials: list[Trial]) -> str:
    """Return the cause if a gain is used wrongly, else an empty string."""
    if not any(np.any(trial.outputs[trial.first :]) for trial in trials):
        return f'{term} is always 0: is {name} used{_MEMORY[term]}?'
    gains = [trial.gain for trial in trials]
    first = ratios[0]
    if first and all(_is(ratio, first) for ratio in ratios):
        return (
            f'{name} has no effect, {term} is the same for {name} = {gains[0]:g} and '
            f'{gains[1]:g}: use the gain that PID gets'
        )
    if all(_is(ratio, gain * gain) for ratio, gain in zip(ratios, gains, strict=True)):
        return f'{name} is in {term} twice'
    return ''


def _common(factors: list[float | None]) -> float | None:
    """Return the factor that is the same for all gains; None if there is none."""
    first = factors[0]
    return first if all(_is(factor, first) for factor in factors) else None


def _is(value: float | None, expected: float | None) -> bool:
    if value is None or expected is None:
        return False
    return abs(value - expected) <= _RELATIVE * abs(expected)


def _example(term: str, formula: str, trial: Trial) -> str:
    expected = trial.gain * trial.variants[0]
    k = trial.first + int(np.argmax(np.abs(trial.outputs - expected)[trial.first :]))
    error = trial.sequence.error
    before = f', after {error[k - 1]:.6g}' if k else ''
    return (
        f'{term} is not {formula}: with a gain of {trial.gain:g}, call {k + 1}, e = {error[k]:.6g} '
        f'm/s{before}, gave {trial.outputs[k]:.6g}, expected about {expected[k]:.6g} m/s²'
    )
