"""Closed loops with somebody's own controller: one at a time, by `closed_loop`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barc_sim.lab.user_code.adapters import UserController
from barc_sim.simulation.metrics import summary
from barc_sim.tuning.cost import Scores

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from barc_sim.lab.user_code.loading import ControllerFactory
    from barc_sim.simulation.log import Log
    from barc_sim.tuning.course import Course


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


def _driven(course: Course, controllers: ControllerFactory, gains: NDArray[np.float64]) -> Log:
    pid = UserController(controllers)
    pid.kp, pid.ki, pid.kd = gains.tolist()
    pid.output_min, pid.output_max = -course.limit, course.limit
    pid.reset()
    return course.drive(pid)


def _loaded(path: Path) -> ControllerFactory:
    """Return the class in the file at `path`; what its code prints goes nowhere."""
    from barc_sim.lab.user_code.loading import load_files  # noqa: PLC0415 (only where it is asked for)

    found = load_files({'controller': path}, output=lambda _: None).controller
    assert found  # noqa: S101 (what is asked for is there, or an error)
    return found
