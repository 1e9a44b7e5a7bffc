"""Seeded inputs on which user code is judged: states for the model, speeds for the controller.

Each situation tests the equations that it `concerns`. No state passes through zero speed within a
step: sensible models differ there. The reference holds the car at a standstill; the lab's equation
does not.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi, radians
from random import Random
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.lab.check.code import Row
from barc_sim.vehicle.bike_model import Vehicle

if TYPE_CHECKING:
    from barc_sim.lab.check.code import Sample
    from barc_sim.lab.check.equations import Floats


#: [s]
TS = 0.02
COUNT = 250  #: states of each situation
_LAB = Vehicle()
Range = tuple[float, float]  #: uniform between the two


@dataclass(frozen=True)
class Situation:
    """Ranges for the arguments of `bikeFE`; by default those of a coasting car.

    Examples
    --------
    >>> turn = Situation('a left turn', 'x y psi', d_f=(0.05, 0.5))
    >>> turn.rows(seed=0, count=3) == turn.rows(seed=0, count=3)
    True
    """

    name: str
    concerns: str  #: the equations it tests, as in `'x y v'`
    x: Range = (-200.0, 200.0)  #: [m]
    y: Range = (-50.0, 50.0)  #: [m]
    psi: Range = (-pi, pi)  #: [rad]
    v: Range = (3.0, 20.0)  #: [m/s]
    a: Range = (0.0, 0.0)  #: [m/s²]
    d_f: Range = (0.0, 0.0)  #: [rad]
    a0: Range = (0.0, 0.0)  #: [N s²/m²]
    m: Range = (_LAB.mass, _LAB.mass)  #: [kg]
    Ff: Range = (0.0, 0.0)  #: [N]
    theta_deg: Range = (0.0, 0.0)
    ts: Range = (TS, TS)  #: [s]
    lengths: tuple[float, float] | None = field(default=None)  #: [m] l_f, l_r; None: the lab's

    def rows(self, seed: int, count: int = COUNT) -> list[Row]:
        """Return `count` states, the same for the same seed."""
        # A string seeds the generator alike in every version of Python.
        uniform = Random(f'{seed} {self.name}').uniform  # noqa: S311 (a simulation, not a secret)
        names = ['theta_deg' if name == 'theta' else name for name in Row._fields]
        drawn = [[uniform(*getattr(self, name)) for name in names] for _ in range(count)]
        return [row._replace(theta=radians(row.theta)) for row in map(Row._make, drawn)]


_LEFT, _RIGHT, _REVERSE = (0.05, 0.5), (-0.5, -0.05), (-15.0, -3.0)
_COMMAND, _DRAG, _FRICTION = (1.0, 8.0), (0.1, 2.0), (20.0, 500.0)

SITUATIONS = (
    Situation('coasting along the x axis', 'x', psi=(0.0, 0.0)),
    Situation('accelerating on the flat', 'x y v', a=_COMMAND),
    Situation('braking on the flat', 'v', a=(-8.0, -1.0)),
    # Without drag and friction, because models differ in sign(0).
    Situation('setting off', 'v', v=(0.0, 0.0), a=_COMMAND),
    Situation('a left turn', 'x y psi', d_f=_LEFT),
    Situation('a right turn', 'x y psi', d_f=_RIGHT),
    Situation('uphill', 'v', theta_deg=(2.0, 30.0)),
    Situation('downhill', 'v', theta_deg=(-30.0, -2.0)),
    Situation('rolling friction', 'v', Ff=_FRICTION),
    Situation('air drag', 'v', a0=_DRAG),
    Situation(
        "the lab's car on hills",
        'x y psi v',
        a=(-8.0, 8.0),
        d_f=(-0.5, 0.5),
        a0=(_LAB.air_drag_coeff, _LAB.air_drag_coeff),
        Ff=(_LAB.friction, _LAB.friction),
        theta_deg=(-30.0, 30.0),
    ),
)
#: The lab's road has none of these.
REVERSE = (
    Situation('reversing to the left', 'x y psi', v=_REVERSE, d_f=_LEFT),
    Situation('reversing to the right', 'x y psi', v=_REVERSE, d_f=_RIGHT),
    Situation('drag and friction in reverse', 'v', v=_REVERSE, a0=_DRAG, Ff=_FRICTION),
    Situation('rolling back on a hill', 'v', v=_REVERSE, Ff=_FRICTION, theta_deg=(2.0, 30.0)),
)
GENERAL = (
    Situation(
        'another mass and time step',
        'x y psi v',
        v=(4.0, 20.0),
        a=(-4.0, 8.0),
        d_f=(-0.5, 0.5),
        a0=_DRAG,
        m=(500.0, 3000.0),
        Ff=_FRICTION,
        theta_deg=(-30.0, 30.0),
        ts=(0.005, 0.1),
    ),
)


def with_lengths(l_f: float, l_r: float) -> Situation:
    """Return the situation for a function that takes the axle distances [m]."""
    return Situation(
        'axles at other distances', 'x y psi', d_f=(-0.5, 0.5), v=(3.0, 20.0), lengths=(l_f, l_r)
    )


LENGTH = 120


@dataclass(frozen=True, eq=False)
class Sequence:
    """The speeds that a controller gets, one sample every `TS`; arrays of shape `(n,)`."""

    reference: Floats  #: [m/s]
    measured: Floats  #: [m/s]

    @property
    def error(self) -> Floats:
        """Reference minus measured [m/s]."""
        return self.reference - self.measured

    def scaled(self, factor: float) -> Sequence:
        """Return the sequence with errors that are `factor` times as large."""
        return Sequence(self.reference, self.reference - factor * self.error)

    @property
    def rows(self) -> list[Sample]:
        """The arguments of each call."""
        pairs = zip(self.reference.tolist(), self.measured.tolist(), strict=True)
        return [(reference, measured, TS) for reference, measured in pairs]


def wandering(seed: int, name: str, amplitude: float) -> Sequence:
    """Return random errors up to ±`amplitude` [m/s], around a reference that changes."""
    uniform = Random(f'{seed} {name}').uniform  # noqa: S311 (a simulation, not a secret)
    error = np.array([uniform(-1.0, 1.0) for _ in range(LENGTH)])
    error[40:60] = uniform(0.5, 1.0)  # a constant error for a while
    steps = [uniform(-0.5, 0.5) for _ in range(4)]
    reference = 8.0 + amplitude * np.repeat(steps, LENGTH // 4)
    return Sequence(reference, reference - amplitude * error)


def constant(error: float, count: int) -> Sequence:
    """Return a constant `error` [m/s], `count` times.

    Examples
    --------
    >>> constant(1.0, 3).rows[0]
    (8.0, 7.0, 0.02)
    """
    reference = np.full(count, 8.0)
    return Sequence(reference, reference - error)
