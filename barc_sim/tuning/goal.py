"""What a search is after: the least cost over some courses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.control.pid import speed_controller
from barc_sim.tuning import batch, compiled, user_controller
from barc_sim.tuning.cost import scores

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log
    from barc_sim.tuning.cost import Cost, Scores
    from barc_sim.tuning.course import Course

    Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Goal:
    """The mean cost over courses; called with gains, it tells what each costs.

    It can be sent to other processes.
    """

    courses: tuple[Course, ...]
    cost: Cost
    controller: Path | None = None  #: the file with it; without one, the PID

    def scores(self, course: Course, gains: Floats) -> Scores:
        """Return the scores over `course` for `gains`, shape `(n, 3)`: kp, ki, kd."""
        if self.controller:
            return user_controller.scores(course, self.controller, gains)
        drive = compiled.drive if compiled.is_available() else batch.drive
        return scores(course, drive(course, gains))

    def __call__(self, gains: Floats) -> Floats:
        """Return what each of `gains`, shape `(n, 3)`, costs, shape `(n,)`."""
        costs = [self.cost.of(self.scores(course, gains)) for course in self.courses]
        return np.asarray(np.mean(costs, axis=0))

    def log(self, course: Course, gains: Floats) -> Log:
        """Return the run over `course` with `gains`, shape `(3,)`."""
        if self.controller:
            return user_controller.drive(course, self.controller, gains)
        kp, ki, kd = gains.tolist()
        return course.drive(speed_controller(kp, ki, kd, course.limit))
