"""Why a term of the PID is wrong: by what constant its answers differ from the right ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.lab.check.situations import TS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from barc_sim.lab.check.equations import Floats
    from barc_sim.lab.check.sequences import Sequence

_RELATIVE = 1e-7


class Trial(NamedTuple):
    """What a term answered with one gain."""

    gain: float
    sequence: Sequence
    outputs: Floats
    variants: list[Floats]  #: what is right, for a gain of 1
    first: int  #: the first answer that counts

    def ratio(self, shapes: Iterable[Floats]) -> float | None:
        """Return the constant by which the answers differ from one of `shapes`; None if by none."""
        outputs = self.outputs[self.first :]
        for shape in (values[self.first :] for values in shapes):
            ratio = float(outputs @ shape / (shape @ shape))
            size = np.max(np.abs(outputs), initial=0.0)
            if np.max(np.abs(outputs - ratio * shape)) <= _RELATIVE * size:
                return ratio
        return None


def proportional_says(trials: list[Trial]) -> str:
    """Return what to look at in the proportional term."""
    ratios = [trial.ratio(trial.variants) for trial in trials]
    if all(_is(ratio, -trial.gain) for ratio, trial in zip(ratios, trials, strict=True)):
        return 'P has the wrong sign: the error is speed_reference - speed_current'
    if said := _of_gain('kp', 'P', ratios, trials):
        return said
    if all(_is(r, t.gain * TS) for r, t in zip(ratios, trials, strict=True)):
        return 'P is multiplied by dt: it is kp * e'
    others: dict[str, Callable[[Trial], Floats]] = {
        'the outputs are added up from call to call: the output is P + I + D of this call alone': (
            lambda t: np.cumsum(t.sequence.error)
        ),
        'P is made from the last error, not from this one': (
            lambda t: np.concatenate([[0.0], t.sequence.error[:-1]])
        ),
        'P has no sign: the error must not go through abs': lambda t: np.abs(t.sequence.error),
        'P is made from the speed alone: the error is speed_reference - speed_current': (
            lambda t: t.sequence.measured
        ),
        'P is made from the reference alone: the error is speed_reference - speed_current': (
            lambda t: t.sequence.reference
        ),
    }
    for says, shape in others.items():
        if all(trial.ratio([shape(trial)]) for trial in trials):
            return says
    return _example('P', 'kp * e', trials[0])


def integral_says(trials: list[Trial]) -> str:
    """Return what to look at in the integral term."""
    ratios = [trial.ratio(trial.variants) for trial in trials]
    if said := _of_gain('ki', 'I', ratios, trials):
        return said
    factors = [r / t.gain if r else None for r, t in zip(ratios, trials, strict=True)]
    factor = _common(factors)
    if factor:
        sign = (
            'I has the wrong sign: it adds up ki * (speed_reference - speed_current) * dt'
            if factor < 0.0
            else ''
        )
        if _is(abs(factor), 1.0 / TS):
            step = 'I is an integrator without dt: each error counts for dt = 0.02 s, ki * e * dt'
        elif _is(abs(factor), 1.0):
            step = ''
        else:
            step = (
                f'I takes dt as {abs(factor) * TS:g} s: a call comes every {TS:g} s, '
                'ki * (sum of e * dt)'
            )
        return '; and '.join(filter(None, [sign, step]))
    if all(t.ratio([t.sequence.error]) for t in trials):
        return 'I forgets: the errors are not added up, or the sum is lost from call to call'
    if all(t.ratio([np.abs(shape) for shape in t.variants]) for t in trials):
        return 'I has no sign: the error must not go through abs'
    if all(
        np.abs(t.outputs[60:] / (t.outputs[60] or 1.0) - 1.0).max() <= _RELATIVE for t in trials
    ):
        return 'I stands still after a while: is the sum limited more tightly than the output?'
    return _example('I', 'ki * (sum of e * dt)', trials[0])


def derivative_says(trials: list[Trial]) -> str:
    """Return what to look at in the derivative term."""
    ratios = [trial.ratio(trial.variants) for trial in trials]
    if said := _of_gain('kd', 'D', ratios, trials):
        return said
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
            step = f'D is a derivative without dt: the change of e is divided by dt = {TS:g} s'
        elif _is(abs(factor), TS * TS):
            step = f'D is multiplied by dt: the change of e is divided by dt = {TS:g} s'
        elif _is(abs(factor), 1.0):
            step = ''
        else:
            step = (
                f'D takes dt as {TS / abs(factor):g} s: a call comes every {TS:g} s, '
                'kd * (e - e_before) / dt'
            )
        return '; and '.join(filter(None, [sign, step]))
    forgets = all(
        t.ratio([t.sequence.error, t.sequence.error - t.sequence.error[0], t.sequence.measured])
        for t in trials
    )
    if forgets:
        return 'D does not keep the error of the last call: e_before is set at the end of each call'
    return _example('D', 'kd * (e - e_before) / dt', trials[0])


def _of_gain(name: str, term: str, ratios: list[float | None], trials: list[Trial]) -> str:
    """Return what to say of a gain that is not used as it should be, or nothing."""
    if not any(np.any(trial.outputs[trial.first :]) for trial in trials):
        return f'there is no {term}: with {name} alone the output is always 0'
    gains = [trial.gain for trial in trials]
    first = ratios[0]
    if first and all(_is(ratio, first) for ratio in ratios):
        return (
            f'{name} has no effect, {term} is the same for {name} = {gains[0]:g} and '
            f'{gains[1]:g}: use the gain that PID is made with'
        )
    if all(_is(ratio, gain * gain) for ratio, gain in zip(ratios, gains, strict=True)):
        return f'{name} is in {term} twice'
    return ''


def _common(factors: list[float | None]) -> float | None:
    """Return the factor that all gains share, None where there is none."""
    first = factors[0]
    return first if all(_is(factor, first) for factor in factors) else None


def _is(value: float | None, expected: float | None) -> bool:
    if value is None or expected is None:
        return False
    return abs(value - expected) <= _RELATIVE * abs(expected)


def _example(term: str, formula: str, trial: Trial) -> str:
    wanted = trial.gain * trial.variants[0]
    k = trial.first + int(np.argmax(np.abs(trial.outputs - wanted)[trial.first :]))
    error = trial.sequence.error
    before = f', after {error[k - 1]:.6g}' if k else ''
    return (
        f'{term} is not {formula}: with a gain of {trial.gain:g}, call {k + 1}, e = {error[k]:.6g} '
        f'm/s{before}, gave {trial.outputs[k]:.6g}, expected about {wanted[k]:.6g} m/s²'
    )
