"""A finding for each criterion, with the data for its figure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log


@dataclass(frozen=True, eq=False)
class Comparison:
    """The closed loop over one road, with the user's controller and with the reference."""

    user: Log
    reference: Log


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Two models under the same commands; states in columns x, y [m], psi [rad], v [m/s]."""

    t: NDArray[np.float64]  #: [s], shape `(n,)`
    user: NDArray[np.float64]  #: shape `(n, 4)`, NaN from where the code failed
    reference: NDArray[np.float64]  #: shape `(n, 4)`


#: User code can return numbers of any size: NumPy does not warn about them.
IGNORE_FLOAT_ERRORS = np.errstate(all='ignore')

EQUATIONS = ('model.x', 'model.y', 'model.psi', 'model.v')
MODEL = (*EQUATIONS, 'model.trajectory', 'model.reverse', 'model.general')
TERMS = ('pid.proportional', 'pid.integral', 'pid.derivative')
PID = (*TERMS, 'pid.dt', 'pid.first_call', 'pid.windup', 'pid.reset')
LOOP = ('loop.lab_road', 'loop.random_roads')
RELAY = (
    'relay.forward',
    'relay.steering',
    'relay.units',
    'relay.release',
    'relay.rate',
    'relay.limits',
    'relay.silence',
)
#: Every criterion, in the order of a report; a rubric names them.
CRITERIA = (*MODEL, *PID, *LOOP, *RELAY)


@dataclass(frozen=True)
class Finding:
    """How far a criterion is met, and what to check if it is not.

    Examples
    --------
    >>> Finding('model.x', score=0.5, message='the sign of sin is wrong').passed
    False
    """

    criterion: str  #: one of `CRITERIA`
    score: float  #: from 0 to 1; 1 is full marks
    message: str  #: one or two sentences, in the terms of the lab
    details: Mapping[str, object] = field(default_factory=dict)  #: JSON types
    #: what a figure shows
    evidence: Comparison | Trajectory | None = field(default=None, compare=False, repr=False)
    skipped: bool = False  #: there is no such file: the score is 0

    factor: float | None = None  #: of a term of the PID: 1 with the lab's formula, dt included

    @property
    def passed(self) -> bool:
        """Whether the criterion has full marks."""
        return self.score >= 1.0
