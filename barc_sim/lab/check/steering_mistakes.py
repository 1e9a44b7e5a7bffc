"""Mistakes that are made with where the car goes: beta, x, y and psi."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barc_sim.lab.check.mistake import Mistake, in_degrees

if TYPE_CHECKING:
    from barc_sim.lab.check.equations import Formula


def _beta(says: str, formula: Formula) -> Mistake:
    return Mistake(says, {'beta': formula})


_BETA = 'beta = atan(l_r / (l_f + l_r) * tan(d_f))'

BETA = (
    _beta(
        'psi grows the wrong way for a left turn (d_f > 0): is the sign of beta right?',
        lambda q: -np.arctan(q.l_r / (q.l_f + q.l_r) * np.tan(q.d_f)),
    ),
    _beta(
        f'beta is as large as d_f: is l_r / (l_f + l_r) missing in {_BETA}?',
        lambda q: q.d_f,
    ),
    Mistake(
        f'l_f stands where l_r belongs, in {_BETA} and in v / l_r * sin(beta)',
        {
            'beta': lambda q: np.arctan(q.l_f / (q.l_f + q.l_r) * np.tan(q.d_f)),
            'psi_rate': lambda q: q.v_turn / q.l_f * np.sin(q.beta),
        },
    ),
    _beta(
        f'l_f stands where l_r belongs in {_BETA}',
        lambda q: np.arctan(q.l_f / (q.l_f + q.l_r) * np.tan(q.d_f)),
    ),
    _beta(f'atan is missing in {_BETA}', lambda q: q.l_r / (q.l_f + q.l_r) * np.tan(q.d_f)),
    _beta(f'tan is missing in {_BETA}', lambda q: np.arctan(q.l_r / (q.l_f + q.l_r) * q.d_f)),
    _beta(f'atan and tan are missing in {_BETA}: small angles only', lambda q: 0.5 * q.d_f),
    _beta(
        f'tan stands where atan belongs in {_BETA}',
        lambda q: np.tan(q.l_r / (q.l_f + q.l_r) * np.tan(q.d_f)),
    ),
    _beta(
        f'sin stands where tan belongs in {_BETA}',
        lambda q: np.arctan(q.l_r / (q.l_f + q.l_r) * np.sin(q.d_f)),
    ),
    _beta(
        f'the ratio of lengths is upside down: {_BETA}',
        lambda q: np.arctan((q.l_f + q.l_r) / q.l_r * np.tan(q.d_f)),
    ),
    _beta(
        f'the brackets around l_f + l_r are missing in {_BETA}',
        lambda q: np.arctan((q.l_r / q.l_f + q.l_r) * np.tan(q.d_f)),
    ),
    _beta(
        f'the brackets around l_f + l_r are missing in {_BETA}',
        lambda q: np.arctan(q.l_r / q.l_f + q.l_r * np.tan(q.d_f)),
    ),
    _beta(
        'beta is in degrees where sin and cos take radians',
        lambda q: np.degrees(np.arctan(q.l_r / (q.l_f + q.l_r) * np.tan(q.d_f))),
    ),
    _beta('d_f has no effect: is beta zero?', lambda q: np.zeros_like(q.v)),
    *in_degrees('d_f'),
)

COURSE = (
    Mistake(
        'beta is missing in x and y: the car moves in the direction psi + beta, not psi',
        {'course': lambda q: q.psi},
    ),
    Mistake(
        'x and y move in the direction psi - beta: is the sign of beta right in psi + beta?',
        {'course': lambda q: q.psi - q.beta},
    ),
    Mistake(
        'psi is missing in x and y: the car moves in the direction psi + beta, not beta',
        {'course': lambda q: q.beta},
    ),
    Mistake(
        'sin and cos are swapped: x goes with cos(psi + beta), y with sin(psi + beta)',
        {
            'x_rate': lambda q: q.v_course * np.sin(q.course),
            'y_rate': lambda q: q.v_course * np.cos(q.course),
        },
    ),
    Mistake(
        'the new v is used for x, y or psi: forward Euler makes all of them from the old v',
        {'v_course': lambda q: q.v_next, 'v_turn': lambda q: q.v_next},
    ),
    Mistake(
        'the new psi is used for x or y: forward Euler makes all of them from the old psi',
        {'course': lambda q: q.psi_next + q.beta},
    ),
    Mistake('d_f stands where beta belongs in psi + beta', {'course': lambda q: q.psi + q.d_f}),
    *in_degrees('psi'),
)

TURN = (
    Mistake(
        'l_f stands where l_r belongs in v / l_r * sin(beta)',
        {'psi_rate': lambda q: q.v_turn / q.l_f * np.sin(q.beta)},
    ),
    Mistake(
        'l_r is missing in psi_next = psi + ts * v / l_r * sin(beta)',
        {'psi_rate': lambda q: q.v_turn * np.sin(q.beta)},
    ),
    Mistake(
        'psi is divided by l_f + l_r where v / l_r * sin(beta) has l_r alone',
        {'psi_rate': lambda q: q.v_turn / (q.l_f + q.l_r) * np.sin(q.beta)},
    ),
    Mistake(
        'psi is multiplied by l_r where v / l_r * sin(beta) divides by it',
        {'psi_rate': lambda q: q.v_turn * q.l_r * np.sin(q.beta)},
    ),
    Mistake(
        'psi is that of the rear axle, v / (l_f + l_r) * tan(d_f), or tan stands where sin belongs '
        'in v / l_r * sin(beta)',
        {'psi_rate': lambda q: q.v_turn / q.l_r * np.tan(q.beta)},
    ),
    Mistake(
        'cos stands where sin belongs in v / l_r * sin(beta)',
        {'psi_rate': lambda q: q.v_turn / q.l_r * np.cos(q.beta)},
    ),
    Mistake(
        'sin is missing in v / l_r * sin(beta)',
        {'psi_rate': lambda q: q.v_turn / q.l_r * q.beta},
    ),
    Mistake(
        'd_f stands where beta belongs in v / l_r * sin(beta)',
        {'psi_rate': lambda q: q.v_turn / q.l_r * np.sin(q.d_f)},
    ),
    Mistake(
        'psi has no speed in it: psi_next = psi + ts * v / l_r * sin(beta)',
        {'psi_rate': lambda q: np.sin(q.beta) / q.l_r},
    ),
)
