"""The model's equations in parts, as text; a mistake replaces some of them.

The scores come from `bike_model.bikeFE`. These parts only find causes; a test compares both.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.lab.check.code import Row
from barc_sim.vehicle.bike_model import GRAVITY

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from types import CodeType

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

NAMES = ('x', 'y', 'psi', 'v')  #: the equations, in the order of what bikeFE returns

#: The formula of each quantity.
EQUATIONS: Mapping[str, str] = {
    'beta': 'atan(l_r / (l_f + l_r) * tan(d_f))',
    'course': 'psi + beta',
    'v_course': 'v',  # the speed that moves x and y
    'v_turn': 'v',  # the speed that turns psi
    'x_rate': 'v_course * cos(course)',
    'y_rate': 'v_course * sin(course)',
    'psi_rate': 'v_turn / l_r * sin(beta)',
    'gravity': '-m * g * sin(theta)',
    'drag': '-a0 * v * abs(v)',
    'friction': '-Ff * sign(v)',
    'force': 'gravity + drag + friction',
    'v_rate': 'a + force / m',
    # Each equation has its own ts and old value, so that a mistake can change one of them.
    **{f'{name}_ts': 'ts' for name in NAMES},
    **{f'{name}_old': name for name in NAMES},
    **{f'{name}_next': f'{name}_old + {name}_ts * {name}_rate' for name in NAMES},
}
_FUNCTIONS = {
    'atan': np.arctan,
    **{name: getattr(np, name) for name in ('abs', 'cos', 'maximum', 'sign', 'sin', 'tan')},
    **{name: getattr(np, name) for name in ('degrees', 'radians')},
}


class Quantities(dict[str, 'Floats']):
    """Quantities by name: arrays of shape `(n,)`, or a number; each is computed when it is used."""

    def __init__(self, given: Mapping[str, Floats], changes: Mapping[str, str]) -> None:
        """Compute from the arguments `given`, with the formulas of `changes`.

        A changed argument is computed from those that were passed.
        """
        super().__init__(given)
        self._formulas = {**EQUATIONS, **changes}
        for name in given.keys() & changes.keys():
            self[name] = _computed(changes[name], given)

    def __missing__(self, name: str) -> Floats:
        """Compute the quantity called `name`."""
        self[name] = _computed(self._formulas[name], self)
        return self[name]


def _computed(formula: str, quantities: Mapping[str, Floats]) -> Floats:
    found: Floats = eval(_compiled(formula), _FUNCTIONS, quantities)  # noqa: S307 (formulas of ours)
    return found


@cache
def _compiled(formula: str) -> CodeType:
    return compile(formula, formula, 'eval')


def arguments(rows: Sequence[Row], l_f: Sequence[float], l_r: Sequence[float]) -> dict[str, Floats]:
    """Return the arguments of `bikeFE` as arrays by name."""
    given = dict(zip(Row._fields, np.array(rows, dtype=np.float64).T, strict=True))
    lengths = {'l_f': np.array(l_f), 'l_r': np.array(l_r)}
    return {**given, **lengths, 'g': np.full(len(rows), GRAVITY)}


class Mistake(NamedTuple):
    """A common mistake in an equation."""

    hint: str  #: what to check, as the user reads it
    changes: dict[str, str]  #: the wrong formulas, by quantity
