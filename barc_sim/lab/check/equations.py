"""The model's equations in parts, for many states at once; each part can be replaced by a mistake.

The scores come from `bike_model.bikeFE`. These parts only find causes; a test compares both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.lab.check.code import Row
from barc_sim.vehicle.bike_model import GRAVITY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

Formula = Callable[['Quantities'], 'Floats']
Changes = Mapping[str, Formula]
NAMES = ('x', 'y', 'psi', 'v')  #: the equations, in the order of what bikeFE returns


def _old(name: str) -> Formula:
    return lambda q: q[name]


def _next(name: str) -> Formula:
    return lambda q: q[f'{name}_old'] + q[f'{name}_ts'] * q[f'{name}_rate']


EQUATIONS: Changes = {
    'beta': lambda q: np.arctan(q.l_r / (q.l_f + q.l_r) * np.tan(q.d_f)),
    'course': lambda q: q.psi + q.beta,
    'v_course': lambda q: q.v,  # the speed that moves x and y
    'v_turn': lambda q: q.v,  # the speed that turns psi
    'x_rate': lambda q: q.v_course * np.cos(q.course),
    'y_rate': lambda q: q.v_course * np.sin(q.course),
    'psi_rate': lambda q: q.v_turn / q.l_r * np.sin(q.beta),
    'gravity': lambda q: -q.m * q.g * np.sin(q.theta),
    'drag': lambda q: -q.a0 * q.v * np.abs(q.v),
    'friction': lambda q: -q.Ff * np.sign(q.v),
    'force': lambda q: q.gravity + q.drag + q.friction,
    'v_rate': lambda q: q.a + q.force / q.m,
    # Each equation has its own ts and old value, so that a mistake can change one of them.
    **{f'{name}_ts': lambda q: q.ts for name in NAMES},
    **{f'{name}_old': _old(name) for name in NAMES},
    **{f'{name}_next': _next(name) for name in NAMES},
}


class Quantities:
    """Computes quantities by name: arrays of shape `(n,)`, each computed once."""

    def __init__(self, given: Mapping[str, Floats], changes: Changes | None = None) -> None:
        """Compute from the arguments `given`, with some formulas changed.

        A change can replace an argument; `given[name]` is still the value that was passed.
        """
        self.given = given
        self._formulas = {**EQUATIONS, **(changes or {})}
        self._known: dict[str, Floats] = {}

    def __getitem__(self, name: str) -> Floats:
        """Return the quantity called `name`."""
        if name not in self._known:
            formula = self._formulas.get(name)
            self._known[name] = self.given[name] if formula is None else formula(self)
        return self._known[name]

    def __getattr__(self, name: str) -> Floats:
        """Return the quantity called `name`, so that formulas read as such."""
        return self[name]


def arguments(rows: Sequence[Row], l_f: Sequence[float], l_r: Sequence[float]) -> dict[str, Floats]:
    """Return the arguments of `bikeFE` as arrays by name."""
    given = dict(zip(Row._fields, np.array(rows, dtype=np.float64).T, strict=True))
    lengths = {'l_f': np.array(l_f), 'l_r': np.array(l_r)}
    return {**given, **lengths, 'g': np.full(len(rows), GRAVITY)}


class Mistake(NamedTuple):
    """A common mistake in an equation."""

    hint: str  #: what to check, as the user reads it
    changes: Changes


def without(name: str) -> Changes:
    """Return the change that sets a quantity to zero."""
    return {name: lambda q: np.zeros_like(q.v)}


def fixed(name: str, value: float) -> Changes:
    """Return the change that fixes a quantity to `value`."""
    return {name: lambda q: np.full_like(q.v, value)}


def wrong_unit(name: str) -> list[Mistake]:
    """Return the mistakes with the unit of an angle."""
    return [
        Mistake(
            f'{name} arrives in radians: is it converted from degrees once more?',
            {name: lambda q: np.radians(q.given[name])},
        ),
        Mistake(
            f'{name} is converted to degrees: it arrives in radians, which sin, cos and tan take',
            {name: lambda q: np.degrees(q.given[name])},
        ),
    ]
