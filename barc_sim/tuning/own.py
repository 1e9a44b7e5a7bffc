"""Closed loops with somebody's own controller: one at a time, by `rollout`."""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.metrics import summary
from barc_sim.pid import PID
from barc_sim.tuning.cost import Scores

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from barc_sim.log import Log
    from barc_sim.student.code import Controller, Controllers
    from barc_sim.tuning.course import Course


class LimitedController(PID):
    """Somebody's controller in place of the PID; its output is limited as the PID's."""

    def __init__(self, controller: Controller, limit: float) -> None:
        """Limit the output of `controller`, whose terms nobody knows, to ±`limit` [m/s²]."""
        super().__init__(nan, nan, nan, output_min=-limit, output_max=limit)
        self._controller = controller
        self.proportional = self.integral = self.derivative = nan

    def acc_calculate(
        self, speed_reference: float, speed_current: float, dt: float | None = None
    ) -> float:
        """Return the limited acceleration [m/s²]."""
        interval = self.dt if dt is None else dt
        wanted = self._controller.acc_calculate(speed_reference, speed_current, interval)
        output = min(max(wanted, self.output_min), self.output_max)
        self.saturated = wanted != output
        return output


def scores(course: Course, path: Path, gains: NDArray[np.float64]) -> Scores:
    """Return the scores of the class in the file at `path`, over `course`.

    `gains` has shape `(n, 3)`. The file is loaded each time: it may have been edited, and a
    cluster's workers outlive searches.
    """
    controllers = _loaded(path)
    rows = [scored(course, _driven(course, controllers, each)) for each in gains]
    return Scores(*np.array(rows).reshape(-1, len(Scores._fields)).T)


def drive(course: Course, path: Path, gains: NDArray[np.float64]) -> Log:
    """Return the run over `course` of the class in the file at `path`, `gains` of shape `(3,)`."""
    return _driven(course, _loaded(path), gains)


def scored(course: Course, log: Log) -> tuple[float, float, float, float]:
    """Return the scores of one run over `course`."""
    if not log.distance[-1] >= course.distance:
        return (np.inf,) * 4
    told = summary(log)
    effort = float(np.sqrt(np.mean(np.square(log.motor))))
    return told.rms_error_after_run_up, told.max_error_after_run_up, told.overshoot, effort


def _driven(course: Course, controllers: Controllers, gains: NDArray[np.float64]) -> Log:
    limit = course.limit
    controller = controllers(*gains.tolist(), output_min=-limit, output_max=limit)
    return course.drive(LimitedController(controller, limit))


def _loaded(path: Path) -> Controllers:
    """Return the class in the file at `path`; what its code prints goes nowhere."""
    from barc_sim.student.code import load  # noqa: PLC0415 (only where it is asked for)

    found = load({'controller': path}, output=lambda _: None).controller
    assert found  # noqa: S101 (what is asked for is there, or an error)
    return found
