"""Common mistakes in the model's equations: of integration, steering and speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barc_sim.lab.check.equations import EQUATIONS, NAMES, Mistake, fixed, without, wrong_unit
from barc_sim.vehicle.bike_model import Vehicle

if TYPE_CHECKING:
    from barc_sim.lab.check.equations import Formula


def _beta(hint: str, formula: Formula) -> Mistake:
    return Mistake(hint, {'beta': formula})


_BETA = 'beta = atan(l_r / (l_f + l_r) * tan(d_f))'

BETA = (
    _beta(
        'psi grows the wrong way for a left turn (d_f > 0): is the sign of beta right?',
        lambda q: -np.arctan(q.l_r / (q.l_f + q.l_r) * np.tan(q.d_f)),
    ),
    _beta(f'beta is as large as d_f: is l_r / (l_f + l_r) missing in {_BETA}?', lambda q: q.d_f),
    Mistake(
        f'l_f is used in place of l_r, in {_BETA} and in v / l_r * sin(beta)',
        {
            'beta': lambda q: np.arctan(q.l_f / (q.l_f + q.l_r) * np.tan(q.d_f)),
            'psi_rate': lambda q: q.v_turn / q.l_f * np.sin(q.beta),
        },
    ),
    _beta(
        f'l_f is used in place of l_r in {_BETA}',
        lambda q: np.arctan(q.l_f / (q.l_f + q.l_r) * np.tan(q.d_f)),
    ),
    _beta(f'atan is missing in {_BETA}', lambda q: q.l_r / (q.l_f + q.l_r) * np.tan(q.d_f)),
    _beta(f'tan is missing in {_BETA}', lambda q: np.arctan(q.l_r / (q.l_f + q.l_r) * q.d_f)),
    _beta(f'atan and tan are missing in {_BETA}: small angles only', lambda q: 0.5 * q.d_f),
    _beta(
        f'tan is used in place of atan in {_BETA}',
        lambda q: np.tan(q.l_r / (q.l_f + q.l_r) * np.tan(q.d_f)),
    ),
    _beta(
        f'sin is used in place of tan in {_BETA}',
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
        'beta is in degrees, but sin and cos take radians',
        lambda q: np.degrees(np.arctan(q.l_r / (q.l_f + q.l_r) * np.tan(q.d_f))),
    ),
    _beta('d_f has no effect: is beta zero?', lambda q: np.zeros_like(q.v)),
    *wrong_unit('d_f'),
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
        'the new v is used for x, y or psi: forward Euler computes all of them from the old v',
        {'v_course': lambda q: q.v_next, 'v_turn': lambda q: q.v_next},
    ),
    Mistake(
        'the new psi is used for x or y: forward Euler computes all of them from the old psi',
        {'course': lambda q: q.psi_next + q.beta},
    ),
    Mistake('d_f is used in place of beta in psi + beta', {'course': lambda q: q.psi + q.d_f}),
    *wrong_unit('psi'),
)

TURN = (
    Mistake(
        'l_f is used in place of l_r in v / l_r * sin(beta)',
        {'psi_rate': lambda q: q.v_turn / q.l_f * np.sin(q.beta)},
    ),
    Mistake(
        'l_r is missing in psi_next = psi + ts * v / l_r * sin(beta)',
        {'psi_rate': lambda q: q.v_turn * np.sin(q.beta)},
    ),
    Mistake(
        'psi is divided by l_f + l_r; v / l_r * sin(beta) has l_r alone',
        {'psi_rate': lambda q: q.v_turn / (q.l_f + q.l_r) * np.sin(q.beta)},
    ),
    Mistake(
        'psi is multiplied by l_r; v / l_r * sin(beta) divides by it',
        {'psi_rate': lambda q: q.v_turn * q.l_r * np.sin(q.beta)},
    ),
    Mistake(
        'psi is that of the rear axle, v / (l_f + l_r) * tan(d_f), or tan is used in place of sin '
        'in v / l_r * sin(beta)',
        {'psi_rate': lambda q: q.v_turn / q.l_r * np.tan(q.beta)},
    ),
    Mistake(
        'cos is used in place of sin in v / l_r * sin(beta)',
        {'psi_rate': lambda q: q.v_turn / q.l_r * np.cos(q.beta)},
    ),
    Mistake(
        'sin is missing in v / l_r * sin(beta)', {'psi_rate': lambda q: q.v_turn / q.l_r * q.beta}
    ),
    Mistake(
        'd_f is used in place of beta in v / l_r * sin(beta)',
        {'psi_rate': lambda q: q.v_turn / q.l_r * np.sin(q.d_f)},
    ),
    Mistake(
        'psi has no speed in it: psi_next = psi + ts * v / l_r * sin(beta)',
        {'psi_rate': lambda q: np.sin(q.beta) / q.l_r},
    ),
)


_LAB = Vehicle()
_F_EXT = 'F_ext = -m * g * sin(theta) - (a0 * v**2 + Ff) * sign(v)'

SPEED = (
    Mistake(
        'drag, friction and gravity are missing: v_next = v + ts * (a + F_ext / m)',
        without('force'),
    ),
    Mistake('air drag is missing: F_ext includes -a0 * v**2 * sign(v)', without('drag')),
    Mistake('rolling friction is missing: F_ext includes -Ff * sign(v)', without('friction')),
    Mistake('gravity is missing: F_ext includes -m * g * sin(theta)', without('gravity')),
    Mistake(
        'air drag and rolling friction are missing in F_ext',
        {**without('drag'), **without('friction')},
    ),
    Mistake(
        'drag and friction push the car on when it reverses: they act against the motion, '
        '-(a0 * v**2 + Ff) * sign(v)',
        {'drag': lambda q: -q.a0 * q.v**2, 'friction': lambda q: -q.Ff},
    ),
    Mistake(
        'drag pushes the car on when it reverses: it acts against the motion, -a0 * v**2 * sign(v)',
        {'drag': lambda q: -q.a0 * q.v**2},
    ),
    Mistake(
        'friction pushes the car on when it reverses: it acts against the motion, -Ff * sign(v)',
        {'friction': lambda q: -q.Ff},
    ),
    Mistake(
        'drag grows with v; it must grow with v**2: -a0 * v**2 * sign(v)',
        {'drag': lambda q: -q.a0 * q.v},
    ),
    Mistake(
        'drag is half of the right value: a0 includes all factors, -a0 * v**2 * sign(v)',
        {'drag': lambda q: -0.5 * q.a0 * q.v * np.abs(q.v)},
    ),
    Mistake(
        'drag and friction speed the car up: are their signs right?',
        {'drag': lambda q: q.a0 * q.v * np.abs(q.v), 'friction': lambda q: q.Ff * np.sign(q.v)},
    ),
    Mistake(
        'drag speeds the car up: is its sign right?', {'drag': lambda q: q.a0 * q.v * np.abs(q.v)}
    ),
    Mistake(
        'friction speeds the car up: is its sign right?',
        {'friction': lambda q: q.Ff * np.sign(q.v)},
    ),
    Mistake(
        'friction is multiplied by the weight: Ff is already a force in newtons',
        {'friction': lambda q: -q.Ff * q.m * q.g * np.sign(q.v)},
    ),
    Mistake(
        'cos is used in place of sin in gravity: -m * g * sin(theta)',
        {'gravity': lambda q: -q.m * q.g * np.cos(q.theta)},
    ),
    Mistake(
        'gravity speeds the car up uphill (theta > 0): is its sign right?',
        {'gravity': lambda q: q.m * q.g * np.sin(q.theta)},
    ),
    Mistake(
        'tan is used in place of sin in gravity: -m * g * sin(theta)',
        {'gravity': lambda q: -q.m * q.g * np.tan(q.theta)},
    ),
    Mistake(
        'sin is missing in gravity: -m * g * sin(theta)',
        {'gravity': lambda q: -q.m * q.g * q.theta},
    ),
    Mistake(
        'gravity acts on the flat, too: it is -m * g * sin(theta)',
        {'gravity': lambda q: -q.m * q.g},
    ),
    Mistake(
        'm and sin(theta) are missing in gravity: the force is -m * g * sin(theta)',
        {'gravity': lambda q: -q.g},
    ),
    Mistake(
        'm is missing in gravity: the force is -m * g * sin(theta)',
        {'gravity': lambda q: -q.g * np.sin(q.theta)},
    ),
    Mistake('g is 9.81: the lab has 9.8 m/s\N{SUPERSCRIPT TWO}', fixed('g', 9.81)),
    Mistake('g is 10: the lab has 9.8 m/s\N{SUPERSCRIPT TWO}', fixed('g', 10.0)),
    *wrong_unit('theta'),
    Mistake(
        'F_ext is not divided by m: v_next = v + ts * (a + F_ext / m)',
        {'v_rate': lambda q: q.a + q.force},
    ),
    Mistake(
        'a is divided by m: it is already an acceleration, v_next = v + ts * (a + F_ext / m)',
        {'v_rate': lambda q: (q.a + q.force) / q.m},
    ),
    Mistake(f'F_ext is Ff alone: {_F_EXT}', {'force': lambda q: q.Ff}),
    Mistake(
        f'F_ext has the wrong sign: v_next = v + ts * (a + F_ext / m) with {_F_EXT}',
        {'v_rate': lambda q: q.a - q.force / q.m},
    ),
    Mistake(
        'the command a is missing: v_next = v + ts * (a + F_ext / m)',
        {'v_rate': lambda q: q.force / q.m},
    ),
    Mistake(
        'v never falls below zero: the car can reverse',
        {'v_next': lambda q: np.maximum(q.v + q.ts * q.v_rate, 0.0)},
    ),
    *(
        Mistake(f'{name} is always {value:g}: use the argument of bikeFE', fixed(name, value))
        for name, value in {'m': _LAB.mass, 'a0': _LAB.air_drag_coeff, 'Ff': _LAB.friction}.items()
    ),
)


def _of_integration(name: str) -> list[Mistake]:
    """Return the mistakes that each of the four equations can have."""
    old, rate, ts = f'{name}_old', f'{name}_rate', f'{name}_ts'
    backwards = {
        'psi': 'psi grows the wrong way for a left turn (d_f > 0): is its sign right?',
        'v': 'v falls when it must grow: is the sign of ts * (a + F_ext / m) right?',
    }.get(name, f'{name} moves backwards: is its sign right?')
    return [
        Mistake(
            f'{name} does not change: is {name}_next computed, and returned?',
            {f'{name}_next': lambda q: q[name]},
        ),
        Mistake(f'{name}_next is always 0: is it computed, and returned?', without(f'{name}_next')),
        Mistake(f'ts is missing in {name}_next', {ts: lambda q: np.ones_like(q.v)}),
        Mistake(f'ts is in {name}_next twice', {ts: lambda q: q.ts**2}),
        Mistake(f'ts is always 0.02 in {name}_next: use the argument of bikeFE', fixed(ts, 0.02)),
        Mistake(
            f'the old {name} is missing: {name}_next = {name} + ts * (its rate of change)',
            without(old),
        ),
        Mistake(
            f'the rate of change is returned in place of {name}_next = {name} + ts * rate',
            {f'{name}_next': lambda q: q[rate]},
        ),
        Mistake(backwards, {ts: lambda q: -q.ts}),
        Mistake(
            f'the car moves forward in {name} when it reverses: keep the sign of v',
            {rate: lambda q: np.sign(q.v) * EQUATIONS[rate](q)},
        ),
    ]


#: The likelier ones first.
MISTAKES: tuple[Mistake, ...] = (
    *(mistake for name in NAMES for mistake in _of_integration(name)),
    *BETA,
    *COURSE,
    *TURN,
    *SPEED,
)
