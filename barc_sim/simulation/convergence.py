"""How fast the error of a step falls with its length, for each model and integrator."""

from __future__ import annotations

from math import hypot
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.simulation.reference_drives import REFERENCE_DRIVES
from barc_sim.vehicle.dynamic_bicycle import DynamicBicycle
from barc_sim.vehicle.integrators import INTEGRATORS
from barc_sim.vehicle.kinematic_bicycle import KinematicBicycle

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from barc_sim.simulation.reference_drives import ReferenceDrive
    from barc_sim.vehicle.bike_model import State

#: [s] The lab's step, halved again and again.
STEPS = tuple(0.02 / 2**k for k in range(5))
#: [s] That of the solution by rk4 that stands for the true one where there is no closed form.
FINE = 0.02 / 128
#: [m] Errors below this are rounding's, not the method's.
ROUNDING = 1e-11


class Study(NamedTuple):
    """The errors of one integrator of one model in one test drive."""

    test_drive: str
    text: str
    reference: str
    model: str
    integrator: str
    errors: tuple[float, ...]  #: [m] of the position at the end, for each of `STEPS`
    order: float  #: the slope of the errors; NaN where rounding leaves fewer than two of them


def studies(drives: Iterable[ReferenceDrive] = REFERENCE_DRIVES) -> Iterator[Study]:
    """Yield the study of each test drive, model and integrator."""
    for test_drive in drives:
        for model in test_drive.models:
            if test_drive.exact:
                reference, (x, y) = 'the closed form', test_drive.exact(test_drive)
            else:
                reference, (x, y) = 'a fine solution', drive(test_drive, model, 'rk4', FINE)[:2]
            for integrator in INTEGRATORS:
                ends = (drive(test_drive, model, integrator, ts) for ts in STEPS)
                errors = tuple(hypot(end.x - x, end.y - y) for end in ends)
                yield Study(
                    test_drive=test_drive.name,
                    text=test_drive.text,
                    reference=reference,
                    model=model,
                    integrator=integrator,
                    errors=errors,
                    order=order(errors),
                )


def drive(test_drive: ReferenceDrive, model: str, integrator: str, ts: float) -> State:
    """Return the state at the end, in steps of `ts` seconds.

    Examples
    --------
    >>> from barc_sim.simulation.reference_drives import REFERENCE_DRIVES
    >>> circle = REFERENCE_DRIVES[0]
    >>> end, exact = drive(circle, 'kinematic', 'euler', 0.02), circle.exact(circle)
    >>> print(f'{hypot(end.x - exact[0], end.y - exact[1]):.2f} m')
    0.25 m
    """
    bicycle: KinematicBicycle | DynamicBicycle = (
        DynamicBicycle(integrator=integrator)
        if model == 'dynamic'
        else KinematicBicycle(integrator)
    )
    state = test_drive.start
    for _ in range(round(test_drive.duration / ts)):
        state = bicycle.step(state, test_drive.held, test_drive.grade, test_drive.vehicle, ts)
    return state


def order(errors: tuple[float, ...]) -> float:
    """Return the slope of log error over log step, for errors [m] of `STEPS`.

    Examples
    --------
    >>> round(order((0.32, 0.16, 0.08, 0.04, 0.02)), 3)
    1.0
    """
    counted = [(ts, error) for ts, error in zip(STEPS, errors, strict=True) if error > ROUNDING]
    if len(counted) < 2:  # noqa: PLR2004 (a slope's least)
        return float('nan')
    steps, found = np.log(counted).T
    return float(np.polyfit(steps, found, 1)[0])
