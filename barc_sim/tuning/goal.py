"""The goal of a search: the least cost over some courses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.control.pid import speed_controller
from barc_sim.simulation.metrics import summary
from barc_sim.tuning import batch
from barc_sim.tuning.cost import Scores, scores

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from barc_sim.control.controller import Controller
    from barc_sim.simulation.log import Log
    from barc_sim.tuning.cost import Cost
    from barc_sim.tuning.course import Course

    Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Goal:
    """The mean cost over courses; a call with gains returns what each costs.

    It can be pickled for other processes, if `new_controller` can.

    Examples
    --------
    >>> import numpy as np
    >>> from barc_sim.tuning.cost import Cost
    >>> from barc_sim.tuning.course import Course
    >>> goal = Goal((Course(),), Cost.parse('rms'))
    >>> print(goal(np.array([[10.0, 20.0, 0.0]])).round(3))
    [0.113]
    """

    courses: tuple[Course, ...]
    cost: Cost
    #: Makes a controller with the gains kp, ki and kd; without it, the PID drives.
    new_controller: Callable[[], Controller] | None = None

    def scores(self, course: Course, gains: Floats) -> Scores:
        """Return the scores over `course` for `gains`, shape `(n, 3)`: kp, ki, kd."""
        if not self.new_controller:
            return scores(course, batch.drive(course, gains))
        controller = self.new_controller()
        rows = [_scored(course, _drive(course, controller, each)) for each in gains]
        return Scores(*np.array(rows).reshape(-1, len(Scores._fields)).T)

    def __call__(self, gains: Floats) -> Floats:
        """Return what each of `gains`, shape `(n, 3)`, costs, shape `(n,)`."""
        costs = [self.cost.of(self.scores(course, gains)) for course in self.courses]
        return np.asarray(np.mean(costs, axis=0))

    def log(self, course: Course, gains: Floats) -> Log:
        """Return the run over `course` with `gains`, shape `(3,)`."""
        new = self.new_controller or speed_controller
        return _drive(course, new(), gains)


def _drive(course: Course, controller: Controller, gains: Floats) -> Log:
    """Return the run of a controller with these gains, from its beginning."""
    for name, gain in zip(('kp', 'ki', 'kd'), gains.tolist(), strict=True):
        setattr(controller, name, gain)
    controller.output_min, controller.output_max = -course.limit, course.limit
    controller.reset()
    return course.drive(controller)


def _scored(course: Course, log: Log) -> tuple[float, float, float, float]:
    """Return the scores of one run over `course`."""
    if not log.distance[-1] >= course.distance:
        return (np.inf,) * 4
    found = summary(log)
    effort = float(np.sqrt(np.mean(np.square(log.motor))))
    return found.rms_error_after_run_up, found.max_error_after_run_up, found.overshoot, effort
