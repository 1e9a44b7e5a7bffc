"""All mistakes with the model's equations that are thought of, the likelier ones first."""

from __future__ import annotations

import numpy as np

from barc_sim.lab.check.equations import EQUATIONS, NAMES
from barc_sim.lab.check.mistake import Mistake, own, zero
from barc_sim.lab.check.speed_mistakes import SPEED
from barc_sim.lab.check.steering_mistakes import BETA, COURSE, TURN


def _of_integration(name: str) -> list[Mistake]:
    """Return what goes wrong alike in each equation."""
    old, rate, ts = f'{name}_old', f'{name}_rate', f'{name}_ts'
    backwards = {
        'psi': 'psi grows the wrong way for a left turn (d_f > 0): is its sign right?',
        'v': 'v falls where it should grow: is the sign of ts * (a + F_ext / m) right?',
    }.get(name, f'{name} moves backwards: is its sign right?')
    return [
        Mistake(
            f'{name} stays as it was: is {name}_next computed, and returned?',
            {f'{name}_next': lambda q: q[name]},
        ),
        Mistake(f'{name}_next is always 0: is it computed, and returned?', zero(f'{name}_next')),
        Mistake(f'ts is missing in {name}_next', {ts: lambda q: np.ones_like(q.v)}),
        Mistake(f'ts is in {name}_next twice', {ts: lambda q: q.ts**2}),
        Mistake(f'ts is 0.02 in {name}_next whatever bikeFE is given', own(ts, 0.02)),
        Mistake(
            f'the old {name} is missing: {name}_next = {name} + ts * (its rate of change)',
            zero(old),
        ),
        Mistake(
            f'the rate of change is returned in place of {name}_next = {name} + ts * rate',
            {f'{name}_next': lambda q: q[rate]},
        ),
        Mistake(backwards, {ts: lambda q: -q.ts}),
        Mistake(
            f'the car goes forwards in {name} when it reverses: v has its sign',
            {rate: lambda q: np.sign(q.v) * EQUATIONS[rate](q)},
        ),
    ]


#: All that is thought of.
MISTAKES: tuple[Mistake, ...] = (
    *(mistake for name in NAMES for mistake in _of_integration(name)),
    *BETA,
    *COURSE,
    *TURN,
    *SPEED,
)
