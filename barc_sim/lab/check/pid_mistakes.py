"""The terms of the PID over a sequence of speeds, and the mistakes that students make in them.

Arrays have a row for each sequence and a column for each call. A term is judged alone: the other
gains are 0, but `kp` in a sequence that finds a gain which multiplies another term.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barc_sim.lab.check.laws import Law, read

if TYPE_CHECKING:
    from collections.abc import Callable

    from barc_sim.lab.check.laws import Floats

_WIDEST = 60  #: calls of a window

_RIGHT = {
    'e': 'reference - measured',
    'area': 'total(e) * dt',
    'change': 'e - before(e)',
    'P': 'kp * e',
    'I': 'ki * area',
    'D': 'kd * change / dt',
}


def _total(values: Floats) -> Floats:
    """Return the sums up to each call."""
    return np.cumsum(values, axis=-1)


def _before(values: Floats, calls: int = 1) -> Floats:
    """Return the values some calls before; the first value before the first call."""
    first = np.repeat(values[:, :1], calls, axis=-1)
    return np.concatenate([first, values[:, :-calls]], axis=-1)


def _delayed(values: Floats, calls: int = 1) -> Floats:
    """Return the values some calls before; 0 before the first call."""
    return np.concatenate([np.zeros((len(values), calls)), values[:, :-calls]], axis=-1)


def _window(values: Floats, calls: int) -> Floats:
    """Return the sums of the last values."""
    sums = np.cumsum(values, axis=-1)
    return sums - _delayed(sums, calls)


def _bounded_total(values: Floats, low: Floats, high: Floats) -> Floats:
    """Return the sums up to each call, each kept within its bounds."""
    sums = np.zeros_like(values)
    total = np.zeros(len(values))
    for k, column in enumerate(values.T):
        total = np.clip(total + column, low.ravel(), high.ravel())
        sums[:, k] = total
    return sums


_FUNCTIONS: dict[str, Callable[..., Floats]] = {
    'total': _total,
    'before': _before,
    'delayed': _delayed,
    'window': _window,
    'bounded_total': _bounded_total,
}

#: The integral adds each error, or the mean of two; the first one in full, half or not at all.
_SUMS = [
    f'{total}{first}'
    for total, firsts in (
        ('total(e)', ('', ' - e[:, :1]')),
        ('total(e) - 0.5 * e', ('', ' - 0.5 * e[:, :1]', ' + 0.5 * e[:, :1]')),
    )
    for first in firsts
]
_AREAS = [f'({each}) * dt' for each in _SUMS]

_GAINS = 'the gains are those of kp * e + ki * (sum of e * dt) + kd * (change of e) / dt'
_D = 'kd * (e - e_before) / dt'
_NEGATIVE = 'the output is never negative: the car must brake, too'

_PROPORTIONAL = f"""
P is always 0: is kp used?
    P = 0 * e
kp has no effect, P is the same for every kp: use the gain that PID gets
    P = e
kp is in P twice
    P = kp**2 * e
P has the wrong sign: the error is speed_reference - speed_current
    P = -kp * e
the outputs of all calls are added up: the output is P + I + D of this call alone
    P = kp * total(e)
P uses the last error, not this one
    P = kp * delayed(e)
P has no sign: do not use abs on the error
    P = kp * abs(e)
P uses the square of the error: it is kp * e
    P = kp * e**2
P uses the speed alone: the error is speed_reference - speed_current
    P = kp * measured
P uses the reference alone: the error is speed_reference - speed_current
    P = kp * reference
the reference is always 8 m/s in P: use speed_reference
    P = kp * (8 - measured)
{_NEGATIVE}
    P = maximum(kp * e, 0)
"""

_INTEGRAL = f"""
I is always 0: is ki used, and is each error added to the sum?
    I = 0 * e
kp multiplies the ki term, too: {_GAINS}
    I = kp * ki * area
ki has no effect, I is the same for every ki: use the gain that PID gets
    I = area
ki is in I twice
    I = ki**2 * area
I has the wrong sign: it adds up ki * (speed_reference - speed_current) * dt
    I = -ki * area
I has no memory: the errors are not added up, or the sum is lost between calls
    I = ki * e
ki multiplies the change of e: are ki and kd mixed up?
    I = ki * (e - delayed(e))
ki multiplies the change of e: are ki and kd mixed up?
    I = ki * (e - before(e))
I has no sign: do not use abs on the error
    I = ki * abs(area)
I has no sign: do not use abs on the error
    e = abs(reference - measured)
I adds up the squares of the errors: they have no sign
    e = (reference - measured)**2
I uses the speed alone: the error is speed_reference - speed_current
    e = measured
the reference is always 8 m/s in I: use speed_reference
    e = 8 - measured
I adds up the sum again at each call: add up e * dt alone
    area = total(total(e)) * dt
{_NEGATIVE}
    I = maximum(ki * area, 0)
the sum is never negative: it adds up errors of both signs
    I = bounded_total(ki * e * dt, 0 * ki, 0 * ki + 1e9)
I stops growing after a while: is the limit of the sum too small?
    I = clip(ki * area, low, high)
I stops growing after a while: is the limit of the sum too small?
    I = bounded_total(ki * e * dt, low, high)
I stops growing after a while: is the limit of the sum too small?
    I = bounded_total(ki * e, low, high)
""" + ''.join(
    f"""
I adds up the last {width} errors only: the integral adds up all of them
    area = window(e, {width})"""
    for width in range(2, _WIDEST)
)

_DERIVATIVE = f"""
D is always 0: is kd used, and is the error of the last call replaced only after D has used it?
    D = 0 * e
kp multiplies the kd term, too: {_GAINS}
    D = kp * kd * change
kd has no effect, D is the same for every kd: use the gain that PID gets
    D = change
kd is in D twice
    D = kd**2 * change
D has the wrong sign: it is {_D}, or with the measured speed -kd * (v - v_before) / dt
    D = -kd * change
D does not store the error of the last call: set e_before = e at the end of each call
    D = kd * e
D does not store the error of the last call: set e_before = e at the end of each call
    D = kd * (e - e[:, :1])
D does not store the error of the last call: set e_before = e at the end of each call
    D = kd * measured
D has no sign: do not use abs on the change of the error
    D = kd * abs(change)
kd multiplies the sum of e: are ki and kd mixed up?
    D = kd * total(e)
D adds the error of the last call: it is {_D}
    D = kd * (e + before(e))
D uses the change of the reference: it is {_D}
    D = kd * (reference - before(reference))
{_NEGATIVE}
    D = maximum(kd * change, 0)
""" + ''.join(
    f"""
D is the change over {width} calls: it is the change since the last call, {_D}
    change = e - before(e, {width})"""
    for width in range(2, _WIDEST)
)

#: By what they are about, the likelier ones first.
MISTAKES = {
    'Proportional term': read(_PROPORTIONAL),
    'Integral term': read(_INTEGRAL),
    'Derivative term': read(_DERIVATIVE),
}
#: The forms of each term that are all right: the integral before or after its use, too.
_FORMS = {
    'P': ({},),
    'I': tuple({'area': area} for area in [*_AREAS, *(f'delayed({area})' for area in _AREAS)]),
    'D': ({}, {'change': 'before(measured) - measured'}),
}
#: Inputs are reference and measured [m/s], dt [s], kp, ki and kd; low and high are the user's
#: minimum and maximum output [m/s²].
TERM_LAWS = {
    name: Law(_RIGHT, mistakes, _FORMS[name], _FUNCTIONS)
    for name, mistakes in zip('PID', MISTAKES.values(), strict=True)
}
