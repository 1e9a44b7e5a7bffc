"""Finds why a term of the PID is wrong, from the factor between its outputs and the right ones."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.lab.check.situations import TS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from barc_sim.lab.check.equations import Floats
    from barc_sim.lab.check.situations import Sequence

_RELATIVE = 1e-7
_WIDEST = 60  #: values of a window
_MOST_DIGITS = 4
_FORMULAS = {'P': 'kp * e', 'I': 'ki * (sum of e * dt)', 'D': 'kd * (e - e_before) / dt'}
#: What else can make a term 0 at all times.
_MEMORY = {
    'P': '',
    'I': ', and is each error added to the sum',
    'D': ', and is the error of the last call replaced only after D has used it',
}
_SIGNS = {
    'P': 'P has the wrong sign: the error is speed_reference - speed_current',
    'I': 'I has the wrong sign: it adds up ki * (speed_reference - speed_current) * dt',
    'D': (
        'D has the wrong sign: it is kd * (e - e_before) / dt, or with the measured speed '
        '-kd * (v - v_before) / dt'
    ),
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

    def fits(self, *shapes: Floats) -> bool:
        """Return whether the outputs have one of `shapes`, up to a constant factor but 0."""
        return bool(self.ratio(shapes))


#: Hints for each term, and whether the outputs show the mistake.
_CAUSES: Mapping[str, Mapping[str, Callable[[Trial], bool]]] = {
    'P': {
        'the outputs of all calls are added up: the output is P + I + D of this call alone': (
            lambda t: t.fits(np.cumsum(t.sequence.error))
        ),
        'P uses the last error, not this one': (
            lambda t: t.fits(np.concatenate([[0.0], t.sequence.error[:-1]]))
        ),
        'P has no sign: do not use abs on the error': lambda t: t.fits(np.abs(t.sequence.error)),
        'P uses the speed alone: the error is speed_reference - speed_current': (
            lambda t: t.fits(t.sequence.measured)
        ),
        'P uses the reference alone: the error is speed_reference - speed_current': (
            lambda t: t.fits(t.sequence.reference)
        ),
    },
    'I': {
        'I has no memory: the errors are not added up, or the sum is lost between calls': (
            lambda t: t.fits(t.sequence.error)
        ),
        'I has no sign: do not use abs on the error': lambda t: t.fits(*map(np.abs, t.variants)),
        **{
            f'I adds up the last {width} errors only: the integral adds up all of them': partial(
                lambda width, t: t.fits(_window(t.sequence.error, width)), width
            )
            for width in range(2, _WIDEST)
        },
        'I stops growing after a while: is the limit of the sum too small?': lambda t: (
            np.abs(t.outputs[60:] / (t.outputs[60] or 1.0) - 1.0).max() <= _RELATIVE
        ),
    },
    'D': {
        'D does not store the error of the last call: set e_before at the end of each call': (
            lambda t: t.fits(
                t.sequence.error, t.sequence.error - t.sequence.error[0], t.sequence.measured
            )
        ),
        **{
            f'D is the change over {width} calls: it is the change since the last call, '
            'kd * (e - e_before) / dt': partial(
                lambda width, t: t.fits(_change(t.sequence.error, width)), width
            )
            for width in range(2, _WIDEST)
        },
    },
}


def diagnose(term: str, trials: list[Trial]) -> str:
    """Return the cause of a wrong `term`: P, I or D."""
    ratios = [trial.ratio(trial.variants) for trial in trials]
    if hint := _diagnose_gain(term, ratios, trials):
        return hint
    factor = _common(ratios, trials)
    if factor is not None and factor < 0.0:
        return _SIGNS[term]
    for hint, shows in _CAUSES[term].items():
        if all(shows(trial) for trial in trials):
            return hint
    return _example(term, trials[0])


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
    factor = _common([trial.ratio(trial.variants) for trial in trials], trials)
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


def _window(values: Floats, width: int) -> Floats:
    """Return the sums of the last `width` values."""
    sums = np.cumsum(values)
    summed: Floats = sums - np.concatenate([np.zeros(width), sums[:-width]])
    return summed


def _change(values: Floats, width: int) -> Floats:
    """Return the changes over `width` values."""
    changed: Floats = values - np.concatenate([np.full(width, values[0]), values[:-width]])
    return changed


def _diagnose_gain(term: str, ratios: list[float | None], trials: list[Trial]) -> str:
    """Return the cause if a gain is used wrongly, else an empty string."""
    name = f'k{term.lower()}'
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


def _common(ratios: list[float | None], trials: list[Trial]) -> float | None:
    """Return the factor to a term that is the same for all gains; None if there is none."""
    factors = [r / t.gain if r else None for r, t in zip(ratios, trials, strict=True)]
    first = factors[0]
    return first if all(_is(factor, first) for factor in factors) else None


def _is(value: float | None, expected: float | None) -> bool:
    if value is None or expected is None:
        return False
    return abs(value - expected) <= _RELATIVE * abs(expected)


def _example(term: str, trial: Trial) -> str:
    expected = trial.gain * trial.variants[0]
    k = trial.first + int(np.argmax(np.abs(trial.outputs - expected)[trial.first :]))
    error = trial.sequence.error
    before = f', after {error[k - 1]:.6g}' if k else ''
    return (
        f'{term} is not {_FORMULAS[term]}: with a gain of {trial.gain:g}, call {k + 1}, '
        f'e = {error[k]:.6g} m/s{before}, gave {trial.outputs[k]:.6g}, expected about '
        f'{expected[k]:.6g} m/s²'
    )
