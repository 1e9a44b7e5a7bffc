"""A finding for each criterion, with the data for its figure."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import wraps
from typing import TYPE_CHECKING, NamedTuple, ParamSpec

import numpy as np

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log

_P = ParamSpec('_P')
#: In each unit; what code returns beyond is not drawn.
NOT_A_CAR = 1e6


class Stretch(NamedTuple):
    """A stretch of one grade, with the speed error on it."""

    start: float  #: [m]
    theta_deg: float
    rms_error: float  #: [m/s]
    max_error: float  #: [m/s] maximum absolute error
    remark: str  #: what the speed does


@dataclass(frozen=True, eq=False)
class Comparison:
    """The closed loop over one road, with the user's controller and with the reference."""

    user: Log
    reference: Log
    stretches: tuple[Stretch, ...] = ()  #: of the user's


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Two models under the same commands; states in columns x, y [m], psi [rad], v [m/s]."""

    t: NDArray[np.float64]  #: [s], shape `(n,)`
    user: NDArray[np.float64]  #: shape `(n, 4)`, NaN from where the code failed
    reference: NDArray[np.float64]  #: shape `(n, 4)`


#: Every criterion, with its name for readers, in the order of a report; a rubric names them.
LABELS = {
    'model.x': 'Model: position x',
    'model.y': 'Model: position y',
    'model.psi': 'Model: heading \N{GREEK SMALL LETTER PSI}',
    'model.v': 'Model: speed v',
    'model.trajectory': 'Model: a whole drive',
    'model.reverse': 'Model: in reverse',
    'model.general': 'Model: another car',
    'pid.proportional': 'PID: proportional term',
    'pid.integral': 'PID: integral term',
    'pid.derivative': 'PID: derivative term',
    'pid.dt': 'PID: the time step',
    'pid.first_call': 'PID: the first call',
    'pid.windup': 'PID: integral at the limit',
    'pid.reset': 'PID: fresh start of a new run',
    'loop.lab_road': "Cruise control: the lab's road",
    'loop.random_roads': 'Cruise control: other roads',
    'relay.forward': 'Relay: up and down',
    'relay.steering': 'Relay: left and right',
    'relay.units': 'Relay: m/s² and radians',
    'relay.release': 'Relay: a released key',
    'relay.rate': 'Relay: commands a second',
    'relay.limits': "Relay: the car's limits",
    'relay.silence': 'Relay: no driver',
}
CRITERIA = tuple(LABELS)
MODEL, PID, LOOP, RELAY = (
    tuple(name for name in CRITERIA if name.startswith(f'{group}.'))
    for group in ('model', 'pid', 'loop', 'relay')
)
EQUATIONS = MODEL[:4]


@dataclass(frozen=True)
class Finding:
    """How far a criterion is met, and what to check if it is not."""

    criterion: str  #: one of `CRITERIA`
    score: float  #: from 0 to 1; 1 is full marks
    message: str  #: one or two sentences, in the terms of the lab
    #: what a figure shows
    evidence: Comparison | Trajectory | None = field(default=None, compare=False, repr=False)
    skipped: bool = False  #: there is no such file: the score is 0
    factor: float | None = None  #: of a term of the PID: 1 with the lab's formula, dt included

    @property
    def passed(self) -> bool:
        """Whether the criterion has full marks."""
        return self.score >= 1.0


#: Score, message and evidence of a finding.
Judged = tuple[float, str] | tuple[float, str, Comparison | Trajectory | None]


def judges(criterion: str) -> Callable[[Callable[_P, Judged]], Callable[_P, Finding]]:
    """Make a function that returns score and message return the finding on `criterion`.

    An error of user code becomes a finding without points. NumPy warns of no number: user code can
    return those of any size.
    """

    def decorate(judge: Callable[_P, Judged]) -> Callable[_P, Finding]:
        @wraps(judge)
        def judged(*args: _P.args, **kwargs: _P.kwargs) -> Finding:
            try:
                with np.errstate(all='ignore'):
                    return Finding(criterion, *judge(*args, **kwargs))
            except UserError as error:
                return Finding(criterion, 0.0, str(error))

        return judged

    return decorate
