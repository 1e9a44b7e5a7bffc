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
    if all(_is(r, t.gain * TS) for r, t in zip(ratios, trials, strict=True)):
        return 'P is multiplied by dt: it is kp * e'
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
    factors = [r / t.gain if r else None for r, t in zip(ratios, trials, strict=True)]
    factor = _common(factors)
    if factor:
        sign = (
            'I has the wrong sign: it adds up ki * (speed_reference - speed_current) * dt'
            if factor < 0.0
            else ''
        )
        if _is(abs(factor), 1.0 / TS):
            step = 'I has no dt: add up ki * e * dt, with dt = 0.02 s'
        elif _is(abs(factor), 1.0):
            step = ''
        else:
            step = (
                f'I uses dt = {abs(factor) * TS:g} s: PID is called every {TS:g} s, '
                'ki * (sum of e * dt)'
            )
        return '; and '.join(filter(None, [sign, step]))
    if all(t.ratio([t.sequence.error]) for t in trials):
        return 'I has no memory: the errors are not added up, or the sum is lost between calls'
    if all(t.ratio([np.abs(shape) for shape in t.variants]) for t in trials):
        return 'I has no sign: do not use abs on the error'
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
    factors = [r / t.gain if r else None for r, t in zip(ratios, trials, strict=True)]
    factor = _common(factors)
    if factor:
        sign = (
            'D has the wrong sign: it is kd * (e - e_before) / dt, or with the measured speed '
            '-kd * (v - v_before) / dt'
            if factor < 0.0
            else ''
        )
        if _is(abs(factor), TS):
            step = f'D has no dt: divide the change of e by dt = {TS:g} s'
        elif _is(abs(factor), TS * TS):
            step = f'D is multiplied by dt: divide the change of e by dt = {TS:g} s'
        elif _is(abs(factor), 1.0):
            step = ''
        else:
            step = (
                f'D uses dt = {TS / abs(factor):g} s: PID is called every {TS:g} s, '
                'kd * (e - e_before) / dt'
            )
        return '; and '.join(filter(None, [sign, step]))
    forgets = all(
        t.ratio([t.sequence.error, t.sequence.error - t.sequence.error[0], t.sequence.measured])
        for t in trials
    )
    if forgets:
        return 'D does not store the error of the last call: set e_before at the end of each call'
    return _example('D', 'kd * (e - e_before) / dt', trials[0])


def _diagnose_gain(name: str, term: str, ratios: list[float | None], trials: list[Trial]) -> str:
    """Return the cause if a gain is used wrongly, else an empty string."""
    if not any(np.any(trial.outputs[trial.first :]) for trial in trials):
        return f'there is no {term}: with {name} alone the output is always 0'
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
