"""What is found of one criterion."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from barc_sim.lab.check.evidence import Comparison, Trajectory

#: For what judges: numbers of any size are compared, and none of them is warned of.
WHATEVER_COMES = np.errstate(all='ignore')

MODEL = ('model.x', 'model.y', 'model.psi', 'model.v', 'model.trajectory')
PID = ('pid.proportional', 'pid.integral', 'pid.derivative', 'pid.windup', 'pid.reset')
LOOP = ('loop.lab_road', 'loop.random_roads')
#: Every criterion, in the order in which they are told; a rubric names them.
CRITERIA = (*MODEL, *PID, *LOOP)


@dataclass(frozen=True)
class Finding:
    """How a criterion is met, and what to look at where it is not."""

    criterion: str  #: one of `CRITERIA`
    score: float  #: from 0 to 1; 1 is met in full
    message: str  #: one sentence or two, in the words of the lab
    details: Mapping[str, object] = field(default_factory=dict)  #: what JSON can hold
    #: what a figure is drawn of
    evidence: Comparison | Trajectory | None = field(default=None, compare=False, repr=False)
    skipped: bool = False  #: the code has no such part: the score is 0

    @property
    def passed(self) -> bool:
        """Whether the criterion is met in full."""
        return self.score >= 1.0
